// Calls to a coordinator: retries what may be repeated, and registers again when the coordinator no
// longer knows this worker.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "metrofarm/farm/v1/farm_service.grpc.pb.h"
#include "rpc/batch.h"
#include "rpc/bundle_cache.h"

namespace metrofarm::rpc {

struct WorkerIdentity {
  std::string name;
  std::string version;
  uint32_t threads = 1;
  std::string instance;  // 32 hex digits, unique per process
};

// Thread-safe. Calls block and retry until they succeed or stop() is called.
class FarmClient {
 public:
  FarmClient(const std::string& address, WorkerIdentity identity);

  void stop() { stopping_ = true; }
  bool stopping() const { return stopping_; }

  // Registers; false only if stopped.
  bool connect();
  double heartbeat_seconds() const { return heartbeat_seconds_; }

  // These return false if stopped, or if the coordinator refused in a way that must not be retried.
  bool lease(uint32_t max_segments, double wait_seconds, farm::v1::LeaseResponse& response);
  bool report(farm::v1::ReportRequest request, farm::v1::ReportResponse& response);
  bool deliver(const Batch& batch, farm::v1::DeliverResponse& response);
  // One attempt; failing is no news, the next beat follows.
  bool heartbeat(farm::v1::HeartbeatRequest request, farm::v1::HeartbeatResponse& response);
  // Empty on success, else what went wrong.
  std::string fetch_bundle(const std::string& digest, BundleWriter& writer);

 private:
  // Runs attempt(context) until it succeeds; see the class comment.
  template <class Attempt>
  bool retry(const char* what, double deadline_seconds, Attempt&& attempt);
  bool handle_failure(const char* what, const grpc::Status& status, int attempts);
  bool register_once();
  std::string worker_id() const;

  WorkerIdentity identity_;
  std::unique_ptr<farm::v1::FarmService::Stub> stub_;
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;  // guards the two below
  std::string worker_id_;
  double heartbeat_seconds_ = 3;
};

}  // namespace metrofarm::rpc
