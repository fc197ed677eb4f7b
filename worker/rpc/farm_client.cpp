#include "rpc/farm_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>

#include "metrofarm/farm/v1/farm_service.grpc.pb.h"
#include "rpc/checksum.h"

namespace metrofarm::rpc {

using grpc::ClientContext;
using grpc::Status;
using grpc::StatusCode;
using Clock = std::chrono::steady_clock;

namespace {

constexpr int kLargestMessage = 256 << 20;
// A connection that is silent for so long is probed, and given up if no answer comes: else a call
// to a machine that vanished would last until its deadline.
constexpr int kKeepaliveMs = 10000;
constexpr int kKeepaliveTimeoutMs = 5000;
// A coordinator that is silent while a bundle is fetched from it has lost the lease by then.
constexpr int kFetchAttempts = 5;

bool is_transient(StatusCode code) {
  switch (code) {
    case StatusCode::UNAVAILABLE:
    case StatusCode::DEADLINE_EXCEEDED:
    case StatusCode::CANCELLED:
    case StatusCode::RESOURCE_EXHAUSTED:
    case StatusCode::ABORTED:
    case StatusCode::UNKNOWN:
    case StatusCode::INTERNAL:
    case StatusCode::NOT_FOUND:
      return true;
    default:
      return false;
  }
}

grpc::ChannelArguments channel_arguments(const Endpoint& endpoint) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kLargestMessage);
  arguments.SetMaxSendMessageSize(kLargestMessage);
  arguments.SetString(GRPC_ARG_DEFAULT_AUTHORITY, endpoint.name);
  // A coordinator that comes back should be found soon.
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 5000);  // time to connect
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // no limit
  // Coordinators behind one name have connections of their own.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return arguments;
}

}  // namespace

double backoff_seconds(int attempts) {
  thread_local std::minstd_rand random(std::random_device{}());
  std::uniform_real_distribution<double> share(0.5, 1.0);
  return share(random) * std::min(3.0, 0.1 * std::exp2(std::clamp(attempts, 0, 10)));
}

struct FarmClient::Impl {
  Endpoint endpoint;
  WorkerIdentity identity;
  Log& log;
  std::unique_ptr<farm::v1::FarmService::Stub> stub;
  mutable std::mutex mutex = {};  // guards what follows
  std::string worker_id = {};
  std::string coordinator_id = {};
  double heartbeat_seconds = 0.1;  // until the coordinator says how many: to be told soon
  Clock::time_point last_answer = Clock::now();
  bool away = true;
  std::string away_reason = {};

  void note(const Status& status) {
    const std::lock_guard lock(mutex);
    // A refusal is an answer, too.
    if (status.ok() || !is_transient(status.error_code()) ||
        status.error_code() == StatusCode::NOT_FOUND) {
      last_answer = Clock::now();
      away = false;
    } else if (status.error_code() != StatusCode::CANCELLED) {
      away = true;
      away_reason = status.error_message();
    }
  }

  std::string id() const {
    const std::lock_guard lock(mutex);
    return worker_id;
  }

  // Makes one attempt, from outside uninterrupted but for the cancellation.
  template <class Attempt>
  Status call(double deadline_seconds, Cancellation& cancellation, Attempt&& attempt) {
    ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::milliseconds(static_cast<int64_t>(1000 * deadline_seconds)));
    const Cancellation::Guard guard(cancellation, [&] { context.TryCancel(); });
    const Status status = attempt(context);
    note(status);
    return status;
  }

  CallResult enroll(Cancellation& cancellation) {
    farm::v1::RegisterRequest request;
    request.set_name(identity.name);
    request.set_version(identity.version);
    request.set_threads(identity.threads);
    request.set_instance(identity.instance);
    farm::v1::RegisterResponse response;
    const Status status = call(10, cancellation, [&](ClientContext& context) {
      return stub->Register(&context, request, &response);
    });
    if (!status.ok()) return judge("register", status, cancellation);
    const std::lock_guard lock(mutex);
    worker_id = response.worker_id();
    coordinator_id = response.coordinator_id();
    heartbeat_seconds = std::clamp(response.heartbeat_seconds(), 0.1, 60.0);
    return CallResult::kDone;
  }

  CallResult judge(const char* what, const Status& status, Cancellation& cancellation) {
    if (status.ok()) return CallResult::kDone;
    if (cancellation.cancelled()) return CallResult::kCancelled;
    if (is_transient(status.error_code())) return CallResult::kAway;
    log.warn("the coordinator refuses a call", {{"rpc.method", what},
                                                {"server.address", endpoint.address},
                                                {"error.message", status.error_message()}});
    return CallResult::kRefused;
  }

  template <class Attempt>
  CallResult once(const char* what, double deadline_seconds, Cancellation& cancellation,
                  Attempt&& attempt) {
    const Status status = call(deadline_seconds, cancellation, attempt);
    if (status.error_code() == StatusCode::NOT_FOUND) enroll(cancellation);
    return judge(what, status, cancellation);
  }

  // attempts: how often at most; 0: as often as it takes.
  template <class Attempt>
  CallResult repeat(const char* what, double deadline_seconds, int attempts,
                    Cancellation& cancellation, Attempt&& attempt) {
    for (int i = 1;; ++i) {
      const CallResult result = once(what, deadline_seconds, cancellation, attempt);
      if (result != CallResult::kAway || i == attempts) return result;
      if (!cancellation.sleep(std::chrono::duration<double>(backoff_seconds(i))))
        return CallResult::kCancelled;
    }
  }
};

FarmClient::FarmClient(const Endpoint& endpoint,
                       const std::shared_ptr<grpc::ChannelCredentials>& credentials,
                       WorkerIdentity identity, Log& log)
    : impl_(new Impl{endpoint, std::move(identity), log,
                     farm::v1::FarmService::NewStub(grpc::CreateCustomChannel(
                         endpoint.address, credentials, channel_arguments(endpoint)))}) {}

FarmClient::~FarmClient() = default;

const Endpoint& FarmClient::endpoint() const {
  return impl_->endpoint;
}

std::string FarmClient::worker_id() const {
  return impl_->id();
}

std::string FarmClient::coordinator_id() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->coordinator_id;
}

double FarmClient::heartbeat_seconds() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->heartbeat_seconds;
}

double FarmClient::away_seconds() const {
  const std::lock_guard lock(impl_->mutex);
  if (!impl_->away) return 0;
  return std::chrono::duration<double>(Clock::now() - impl_->last_answer).count();
}

std::string FarmClient::away_reason() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->away_reason;
}

CallResult FarmClient::enroll(Cancellation& cancellation) {
  return impl_->enroll(cancellation);
}

CallResult FarmClient::lease(uint32_t max_segments, double wait_seconds,
                             farm::v1::LeaseResponse& response, Cancellation& cancellation) {
  return impl_->once("lease", wait_seconds + 20, cancellation, [&](ClientContext& context) {
    farm::v1::LeaseRequest request;
    request.set_worker_id(worker_id());
    request.set_max_segments(max_segments);
    request.set_wait_seconds(wait_seconds);
    return impl_->stub->Lease(&context, request, &response);
  });
}

CallResult FarmClient::heartbeat(farm::v1::HeartbeatRequest request,
                                 farm::v1::HeartbeatResponse& response,
                                 Cancellation& cancellation) {
  return impl_->once("heartbeat", 5, cancellation, [&](ClientContext& context) {
    request.set_worker_id(worker_id());
    return impl_->stub->Heartbeat(&context, request, &response);
  });
}

CallResult FarmClient::release(const std::vector<farm::v1::LeaseRef>& leases, bool leaving) {
  farm::v1::ReleaseRequest request;
  request.set_worker_id(worker_id());
  request.set_leaving(leaving);
  for (const farm::v1::LeaseRef& lease : leases) *request.add_leases() = lease;
  farm::v1::ReleaseResponse response;
  Cancellation never;
  const Status status = impl_->call(2, never, [&](ClientContext& context) {
    return impl_->stub->Release(&context, request, &response);
  });
  // A coordinator that does not know the worker has nothing to take back.
  return status.error_code() == StatusCode::NOT_FOUND ? CallResult::kDone
                                                      : impl_->judge("release", status, never);
}

CallResult FarmClient::report(farm::v1::ReportRequest request, farm::v1::ReportResponse& response,
                              Cancellation& cancellation) {
  return impl_->repeat("report", 60, 0, cancellation, [&](ClientContext& context) {
    request.set_worker_id(worker_id());  // another one where the attempt before had to register
    request.set_checksum(checksum(request));
    return impl_->stub->Report(&context, request, &response);
  });
}

CallResult FarmClient::deliver(const Batch& batch, farm::v1::DeliverResponse& response,
                               Cancellation& cancellation) {
  return impl_->repeat("deliver", 300, 0, cancellation, [&](ClientContext& context) {
    const auto stream = impl_->stub->Deliver(&context, &response);
    farm::v1::DeliverRequest opening;
    opening.mutable_header()->set_worker_id(worker_id());
    *opening.mutable_header()->mutable_batch() = batch.header;
    bool open = stream->Write(opening);
    for (size_t i = 0; open && i < batch.tiles.size(); ++i) {
      farm::v1::DeliverRequest message;
      *message.mutable_tiles() = batch.tiles[i];
      open = stream->Write(message);
    }
    stream->WritesDone();
    return stream->Finish();
  });
}

CallResult FarmClient::fetch_bundle(const std::string& digest, BundleWriter& writer,
                                    std::string& problem, Cancellation& cancellation) {
  bool missing = false;
  const CallResult result = impl_->repeat(
      "fetch bundle", 3600, kFetchAttempts, cancellation, [&](ClientContext& context) {
        farm::v1::FetchBundleRequest request;
        request.set_worker_id(worker_id());
        request.set_bundle_digest(digest);
        const auto stream = impl_->stub->FetchBundle(&context, request);
        farm::v1::FetchBundleResponse piece;
        while (problem.empty() && stream->Read(&piece)) {
          problem = piece.has_manifest() ? writer.begin(piece.manifest(), digest)
                                         : writer.append(piece.data());
        }
        if (!problem.empty()) context.TryCancel();
        const Status status = stream->Finish();
        missing = status.error_code() == StatusCode::NOT_FOUND;
        return problem.empty() ? status : Status::OK;
      });
  if (result == CallResult::kAway && missing) return CallResult::kRefused;
  if (result == CallResult::kDone && problem.empty()) problem = writer.finish();
  return result;
}

}  // namespace metrofarm::rpc
