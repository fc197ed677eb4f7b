// The leases that this worker holds of one coordinator, renewed by heartbeats from a thread of its
// own.
#pragma once

#include <condition_variable>
#include <map>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "metrofarm/farm/v1/task.pb.h"
#include "rpc/farm_client.h"

namespace metrofarm::rpc {

// Thread-safe.
class Leases {
 public:
  explicit Leases(FarmClient& client);
  ~Leases();

  void hold(const farm::v1::Task& task);
  void forget(const std::string& task_id);
  // Forgets all of them, for good: no heartbeat follows. Says which they were.
  std::vector<farm::v1::LeaseRef> forget_all();
  void set_activity(const std::string& activity);
  void set_fraction(const std::string& task_id, double fraction);

  // True if the lease is lost: what was not begun of the task is left to others.
  bool abandoned(const std::string& task_id) const;
  // Is told when nothing of the task will be counted, by the lease that is held now. What it calls
  // must not return here.
  std::stop_token interruption(const std::string& task_id) const;
  size_t count() const;
  // True once the coordinator has asked this worker to finish and leave.
  bool drain_requested() const;

 private:
  struct Held {
    uint64_t epoch = 0;
    double fraction = 0;
    bool abandoned = false;
    std::stop_source interruption;
  };
  void beat_until_stopped();
  farm::v1::HeartbeatRequest request() const;
  void obey(const farm::v1::HeartbeatResponse& response);

  FarmClient& client_;
  Cancellation cancellation_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  bool drain_ = false;
  std::string activity_;
  std::map<std::string, Held> held_;
  std::thread thread_;
};

}  // namespace metrofarm::rpc
