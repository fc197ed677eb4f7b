// The worker's dealings with one coordinator.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "rpc/batch_size.h"
#include "rpc/farm_client.h"
#include "rpc/intake.h"
#include "rpc/leases.h"
#include "rpc/outbox.h"

namespace metrofarm::rpc {

class Metrics;

// What all coordinators have to do with.
struct Shared {
  Log& log;
  Metrics& metrics;
  Intake& intake;
  Outbox& outbox;
  // A coordinator says that what this worker has of a job is wrong.
  std::function<void()> conflict;
};

// Registers, asks for work when the intake says so, renews leases and delivers, each on a thread of
// its own: a coordinator that is away, or hangs, holds nobody else up. Thread-safe.
class Link : public std::enable_shared_from_this<Link> {
 public:
  Link(const Endpoint& endpoint, const std::shared_ptr<grpc::ChannelCredentials>& credentials,
       const WorkerIdentity& identity, const Shared& shared);
  ~Link();

  // Starts asking; once, after the link is owned by a shared_ptr.
  void start();
  // Asks for no more work, for good; what is held is finished and delivered.
  void stop_leasing();
  // Gives all leases back and tells the coordinator that the worker is leaving.
  void leave();

  FarmClient& client() { return client_; }
  Leases& leases() { return leases_; }
  BatchSize& batch_size() { return batch_size_; }

  bool connected() const { return connected_; }
  // Asks no more and has nothing left to deliver.
  bool finished() const;
  bool drain_requested() const { return drain_ || leases_.drain_requested(); }

  // Leases that will not be used; the coordinator grants them anew.
  void give_back(const std::vector<farm::v1::LeaseRef>& refs);

 private:
  void ask();
  bool ask_while_connected();  // whether the coordinator answered at all
  CallResult lease(const Turn& turn, Intake::Seat seat);
  void deliver();
  void send(Parcel& parcel);
  void drop(const Parcel& parcel);
  void send_reports(Parcel& parcel);
  void send_batches(Parcel& parcel);
  void note(farm::v1::Outcome outcome, const std::string& message, const std::string& task);
  LogAttributes about() const;

  Shared shared_;
  FarmClient client_;
  Leases leases_;
  BatchSize batch_size_;
  Cancellation asking_;
  std::atomic<bool> connected_{false}, drain_{false}, asks_no_more_{false};
  std::thread asker_, deliverer_;
};

}  // namespace metrofarm::rpc
