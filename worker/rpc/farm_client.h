// Calls to one coordinator.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/log.h"
#include "metrofarm/farm/v1/farm_service.pb.h"
#include "rpc/batch.h"
#include "rpc/bundle_writer.h"
#include "rpc/cancellation.h"

namespace grpc {
class ChannelCredentials;
}

namespace metrofarm::rpc {

struct WorkerIdentity {
  std::string name;
  std::string version;
  uint32_t threads = 1;
  std::string instance;  // 32 hex digits, unique per process
};

// Where a coordinator is.
struct Endpoint {
  std::string address;  // HOST:PORT, numeric
  std::string name;     // HOST:PORT as the user gave it: what a certificate must be for

  auto operator<=>(const Endpoint&) const = default;
};

// What came of a call.
enum class CallResult {
  kDone,
  kAway,     // nobody answers; the call may be repeated
  kRefused,  // an answer that repeating will not change
  kCancelled,
};

// Thread-safe.
class FarmClient {
 public:
  FarmClient(const Endpoint& endpoint, const std::shared_ptr<grpc::ChannelCredentials>& credentials,
             WorkerIdentity identity, Log& log);
  ~FarmClient();

  const Endpoint& endpoint() const;
  // From Register; empty before.
  std::string worker_id() const;
  std::string coordinator_id() const;
  double heartbeat_seconds() const;
  // Seconds since the coordinator was last known to answer, 0 while it does.
  double away_seconds() const;
  // Why the last call that nobody answered was not, as far as is known.
  std::string away_reason() const;

  // One attempt each. Where the coordinator does not know the worker any more they register it
  // again and answer kAway.
  CallResult enroll(Cancellation& cancellation);
  CallResult lease(uint32_t max_segments, double wait_seconds, farm::v1::LeaseResponse& response,
                   Cancellation& cancellation);
  CallResult heartbeat(farm::v1::HeartbeatRequest request, farm::v1::HeartbeatResponse& response,
                       Cancellation& cancellation);
  CallResult release(const std::vector<farm::v1::LeaseRef>& leases, bool leaving);

  // These repeat, with growing pauses, until they are done, refused or cancelled.
  CallResult report(farm::v1::ReportRequest request, farm::v1::ReportResponse& response,
                    Cancellation& cancellation);
  CallResult deliver(const Batch& batch, farm::v1::DeliverResponse& response,
                     Cancellation& cancellation);
  // problem: empty where all went well, or if the result is not kDone.
  CallResult fetch_bundle(const std::string& digest, BundleWriter& writer, std::string& problem,
                          Cancellation& cancellation);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The pause before a call is repeated: doubles from 0.1 s to 3 s, and is up to half shorter, by
// chance, so that workers that lost a coordinator together do not come back together.
double backoff_seconds(int attempts);

}  // namespace metrofarm::rpc
