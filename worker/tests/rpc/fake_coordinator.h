// A coordinator for tests: hands out path segments of one small scene and keeps account of them.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "metrofarm/farm/v1/farm_service.pb.h"

namespace grpc {
class ServerCredentials;
}

namespace metrofarm::test {

// Waits until a condition holds; false after five minutes, which
// only a machine that is very busy needs.
bool eventually(const std::function<bool()>& condition);

class FakeCoordinator {
 public:
  // Listens on two free ports of the loopback interface.
  explicit FakeCoordinator(const std::shared_ptr<grpc::ServerCredentials>& credentials = nullptr);
  ~FakeCoordinator();

  std::string address() const;
  std::string second_address() const;

  // Ends all calls and forgets all workers; work stays. start() listens on the same port again.
  void stop();
  void start();

  // Adds segments to be leased, each of `samples` samples for 64 pixels.
  void add_segments(int count, uint64_t samples = 4);
  // Instead of the scene's own.
  void set_scene(const std::string& xml);
  // What lease answers say of it; the default lets every lease be delivered by itself.
  void seal_every(double seconds);
  void drain();
  // Leases on segments of so many samples are gone: their job is canceled, or, where workers are to
  // hear of ABANDON, others were faster.
  void withdraw(uint64_t samples, farm::v1::Directive directive = farm::v1::DIRECTIVE_INTERRUPT);
  // Lease calls, or deliveries, hang from now on, until they are cancelled or this is set to false.
  void hang(bool on);
  void hang_deliveries(bool on);

  // What workers did.
  struct Account {
    int registered = 0;
    int polls = 0;         // lease calls
    int waiting = 0;       // lease calls under way
    int open = 0;          // segments that can be leased
    int granted = 0;       // segments
    int most_granted = 0;  // segments in one answer
    int most_renewed = 0;  // leases in one heartbeat
    int delivered = 0;     // segments
    int batches = 0;
    int unsound = 0;     // batches whose tiles or segments are not what their header says
    int released = 0;    // leases, by name
    int left = 0;        // workers
    int fetched = 0;     // bundles
    int delivering = 0;  // batches that are not answered yet
    std::vector<farm::v1::TaskFailure> failures;
    std::vector<std::chrono::steady_clock::time_point> grants;
  };
  Account account() const;
  // Values of everything that was delivered.
  std::vector<int64_t> film() const;

 private:
  class Service;
  std::unique_ptr<Service> service_;
};

}  // namespace metrofarm::test
