#include "rpc/farm_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

namespace metrofarm::rpc {

using namespace std::chrono_literals;
using grpc::ClientContext;
using grpc::Status;
using grpc::StatusCode;

namespace {

constexpr int kLargestMessage = 256 << 20;

void set_deadline(ClientContext& context, double seconds) {
  context.set_deadline(std::chrono::system_clock::now() +
                       std::chrono::milliseconds(static_cast<int64_t>(1000 * seconds)));
}

// 0.1 s, doubling up to 3 s.
std::chrono::milliseconds backoff(int attempts) {
  return std::min(100ms * (1 << std::min(attempts, 5)), std::chrono::milliseconds(3000));
}

bool may_repeat(StatusCode code) {
  return code == StatusCode::UNAVAILABLE || code == StatusCode::DEADLINE_EXCEEDED ||
         code == StatusCode::CANCELLED || code == StatusCode::RESOURCE_EXHAUSTED ||
         code == StatusCode::ABORTED || code == StatusCode::UNKNOWN || code == StatusCode::INTERNAL;
}

}  // namespace

FarmClient::FarmClient(const std::string& address, WorkerIdentity identity)
    : identity_(std::move(identity)) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kLargestMessage);
  arguments.SetMaxSendMessageSize(kLargestMessage);
  // A coordinator that comes back should be found soon.
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  stub_ = farm::v1::FarmService::NewStub(
      grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
}

std::string FarmClient::worker_id() const {
  const std::lock_guard lock(mutex_);
  return worker_id_;
}

bool FarmClient::register_once() {
  farm::v1::RegisterRequest request;
  request.set_name(identity_.name);
  request.set_version(identity_.version);
  request.set_threads(identity_.threads);
  request.set_instance(identity_.instance);
  farm::v1::RegisterResponse response;
  ClientContext context;
  set_deadline(context, 10);
  const Status status = stub_->Register(&context, request, &response);
  if (!status.ok()) return false;
  const std::lock_guard lock(mutex_);
  worker_id_ = response.worker_id();
  heartbeat_seconds_ = std::clamp(response.heartbeat_seconds(), 0.1, 60.0);
  return true;
}

bool FarmClient::connect() {
  for (int attempts = 0; !stopping_; ++attempts) {
    if (register_once()) return true;
    if (attempts == 20) std::fprintf(stderr, "metrofarm-worker: waiting for the coordinator\n");
    std::this_thread::sleep_for(backoff(attempts));
  }
  return false;
}

// True: try again. False: give up.
bool FarmClient::handle_failure(const char* what, const Status& status, int attempts) {
  if (stopping_) return false;
  if (status.error_code() == StatusCode::NOT_FOUND && attempts < 3) return connect();
  if (!may_repeat(status.error_code())) {
    std::fprintf(stderr, "metrofarm-worker: %s: %s\n", what, status.error_message().c_str());
    return false;
  }
  std::this_thread::sleep_for(backoff(attempts));
  return !stopping_;
}

template <class Attempt>
bool FarmClient::retry(const char* what, double deadline_seconds, Attempt&& attempt) {
  // The first attempt is made even while stopping: finished work still gets through.
  for (int attempts = 0;; ++attempts) {
    ClientContext context;
    set_deadline(context, deadline_seconds);
    const Status status = attempt(context);
    if (status.ok()) return true;
    if (!handle_failure(what, status, attempts)) return false;
  }
}

bool FarmClient::lease(uint32_t max_segments, double wait_seconds,
                       farm::v1::LeaseResponse& response) {
  return retry("lease", wait_seconds + 20, [&](ClientContext& context) {
    farm::v1::LeaseRequest request;
    request.set_worker_id(worker_id());
    request.set_max_segments(max_segments);
    request.set_wait_seconds(wait_seconds);
    return stub_->Lease(&context, request, &response);
  });
}

bool FarmClient::report(farm::v1::ReportRequest request, farm::v1::ReportResponse& response) {
  return retry("report", 60, [&](ClientContext& context) {
    request.set_worker_id(worker_id());
    return stub_->Report(&context, request, &response);
  });
}

bool FarmClient::deliver(const Batch& batch, farm::v1::DeliverResponse& response) {
  return retry("deliver", 300, [&](ClientContext& context) {
    const auto stream = stub_->Deliver(&context, &response);
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

bool FarmClient::heartbeat(farm::v1::HeartbeatRequest request,
                           farm::v1::HeartbeatResponse& response) {
  ClientContext context;
  set_deadline(context, 5);
  request.set_worker_id(worker_id());
  const Status status = stub_->Heartbeat(&context, request, &response);
  if (status.error_code() == StatusCode::NOT_FOUND) register_once();
  return status.ok();
}

std::string FarmClient::fetch_bundle(const std::string& digest, BundleWriter& writer) {
  std::string problem;
  const bool fetched = retry("fetch bundle", 3600, [&](ClientContext& context) {
    farm::v1::FetchBundleRequest request;
    request.set_worker_id(worker_id());
    request.set_bundle_digest(digest);
    const auto stream = stub_->FetchBundle(&context, request);
    farm::v1::FetchBundleResponse piece;
    while (problem.empty() && stream->Read(&piece)) {
      problem = piece.has_manifest() ? writer.begin(piece.manifest(), digest)
                                     : writer.append(piece.data());
    }
    if (!problem.empty()) context.TryCancel();
    const Status status = stream->Finish();
    return problem.empty() ? status : Status::OK;
  });
  if (!problem.empty()) return problem;
  if (!fetched) return "the scene bundle could not be fetched";
  return writer.finish();
}

}  // namespace metrofarm::rpc
