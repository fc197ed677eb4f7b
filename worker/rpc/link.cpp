#include "rpc/link.h"

#include <algorithm>
#include <new>

#include "rpc/metrics.h"

namespace metrofarm::rpc {

namespace {

// A coordinator that starts together with its workers is there before so many, after some seconds.
constexpr int kPatientAttempts = 5;

std::string job_of(const std::string& task_id) {
  return task_id.substr(0, task_id.find('/'));
}

farm::v1::LeaseRef ref_to(const farm::v1::Task& task) {
  farm::v1::LeaseRef ref;
  ref.set_task_id(task.task_id());
  ref.set_epoch(task.epoch());
  return ref;
}

// As told, within reason.
double seal_seconds_of(const farm::v1::LeaseResponse& response) {
  constexpr double kUsual = 3, kMost = 600;
  const double told = response.seal_seconds();
  return told > 0 ? std::min(told, kMost) : kUsual;
}

uint64_t bytes_of(const Batch& batch) {
  uint64_t bytes = batch.header.ByteSizeLong();
  for (const auto& message : batch.tiles) bytes += message.ByteSizeLong();
  return bytes;
}

}  // namespace

Link::Link(const Endpoint& endpoint, const std::shared_ptr<grpc::ChannelCredentials>& credentials,
           const WorkerIdentity& identity, const Shared& shared)
    : shared_(shared),
      client_(endpoint, credentials, identity, shared.log),
      leases_(client_),
      batch_size_(identity.threads) {}

Link::~Link() {
  stop_leasing();
  shared_.outbox.close(this);
  if (asker_.joinable()) asker_.join();
  if (deliverer_.joinable()) deliverer_.join();
  shared_.outbox.forget(this);
}

void Link::start() {
  asker_ = std::thread([this] { ask(); });
  deliverer_ = std::thread([this] { deliver(); });
}

void Link::stop_leasing() {
  asking_.cancel();
}

bool Link::finished() const {
  return asks_no_more_ && leases_.count() == 0 && shared_.outbox.count_for(this) == 0;
}

LogAttributes Link::about() const {
  return {{"server.address", client_.endpoint().address}};
}

void Link::give_back(const std::vector<farm::v1::LeaseRef>& refs) {
  if (refs.empty()) return;
  for (const farm::v1::LeaseRef& ref : refs) leases_.forget(ref.task_id());
  client_.release(refs, false);
}

void Link::leave() {
  const auto refs = leases_.forget_all();
  if (!client_.worker_id().empty()) client_.release(refs, true);
}

// ---- asking ----

void Link::ask() {
  for (int attempts = 0; !asking_.cancelled();) {
    switch (client_.enroll(asking_)) {
      case CallResult::kDone:
        attempts = ask_while_connected() ? 0 : attempts + 1;
        break;
      case CallResult::kAway:
        if (++attempts == kPatientAttempts) {
          shared_.log.warn(
              "waiting for a coordinator: nobody answers there, or the TLS options "
              "here do not fit those there",
              {{"server.address", client_.endpoint().address},
               {"error.message", client_.away_reason()}});
        }
        break;
      case CallResult::kRefused:
        attempts = std::max(attempts + 1, 10);
        asking_.sleep(std::chrono::seconds(10));
        break;
      case CallResult::kCancelled:
        break;
    }
    asking_.sleep(std::chrono::duration<double>(backoff_seconds(attempts)));
  }
  asks_no_more_ = true;
}

bool Link::ask_while_connected() {
  shared_.log.info("registered with a coordinator", about());
  connected_ = true;
  const Intake::Seat seat = shared_.intake.join();
  CallResult result = CallResult::kDone;
  bool answered = false;
  while (result == CallResult::kDone && !drain_ && !asking_.cancelled()) {
    const auto turn = shared_.intake.await_turn(seat, batch_size_.segments());
    if (!turn) break;
    result = lease(*turn, seat);
    answered = answered || result == CallResult::kDone;
  }
  shared_.intake.leave(seat);
  connected_ = false;
  if (result == CallResult::kAway) shared_.log.warn("lost a coordinator", about());
  return answered;
}

CallResult Link::lease(const Turn& turn, Intake::Seat seat) {
  farm::v1::LeaseResponse response;
  const CallResult result = client_.lease(turn.max_segments, turn.wait_seconds, response, asking_);
  if (result != CallResult::kDone) return result;
  if (response.drain()) drain_ = true;
  Leased leased{shared_from_this(),
                {response.tasks().begin(), response.tasks().end()},
                seal_seconds_of(response)};
  std::vector<farm::v1::LeaseRef> refs;
  for (const farm::v1::Task& task : leased.tasks) {
    leases_.hold(task);
    refs.push_back(ref_to(task));
  }
  if (!shared_.intake.answer(seat, std::move(leased))) give_back(refs);
  return result;
}

// ---- delivering ----

void Link::deliver() {
  while (const auto parcel = shared_.outbox.take(this)) {
    try {
      send(*parcel);
    } catch (const std::bad_alloc&) {
      drop(*parcel);
    }
    shared_.outbox.done(parcel);
  }
}

void Link::send(Parcel& parcel) {
  send_reports(parcel);
  send_batches(parcel);
}

// Memory does not suffice to send it: others may do the work.
void Link::drop(const Parcel& parcel) {
  shared_.log.warn("a result is lost: the worker's memory does not suffice to send it", about());
  std::vector<farm::v1::LeaseRef> refs;
  for (const farm::v1::ReportRequest& report : parcel.results.reports)
    refs.push_back(report.lease());
  for (const Batch& batch : parcel.results.batches)
    for (const auto& segment : batch.header.segments()) refs.push_back(segment.lease());
  shared_.metrics.segments_left("released", refs.size());
  give_back(refs);
}

void Link::send_reports(Parcel& parcel) {
  for (const farm::v1::ReportRequest& report : parcel.results.reports) {
    farm::v1::ReportResponse response;
    const std::string& task = report.lease().task_id();
    if (report.has_failure())
      shared_.log.warn("a task failed", {{"server.address", client_.endpoint().address},
                                         {"metrofarm.job", job_of(task)},
                                         {"metrofarm.task", task},
                                         {"error.message", report.failure().message()}});
    if (client_.report(report, response, parcel.cancellation) == CallResult::kDone)
      note(response.outcome(), response.message(), task);
    leases_.forget(task);
  }
}

void Link::send_batches(Parcel& parcel) {
  for (const Batch& batch : parcel.results.batches) {
    farm::v1::DeliverResponse response;
    const bool answered =
        client_.deliver(batch, response, parcel.cancellation) == CallResult::kDone;
    const std::string outcome = answered ? outcome_name(response.outcome()) : "lost";
    shared_.metrics.batch(outcome, static_cast<size_t>(batch.header.segments_size()),
                          bytes_of(batch));
    if (answered)
      note(response.outcome(), response.message(), batch.header.segments(0).lease().task_id());
    for (const auto& segment : batch.header.segments()) leases_.forget(segment.lease().task_id());
  }
}

void Link::note(farm::v1::Outcome outcome, const std::string& message, const std::string& task) {
  if (outcome == farm::v1::OUTCOME_CONFLICT) shared_.conflict();
  const LogAttributes attributes = {{"server.address", client_.endpoint().address},
                                    {"metrofarm.job", job_of(task)},
                                    {"metrofarm.task", task},
                                    {"metrofarm.outcome", outcome_name(outcome)},
                                    {"error.message", message}};
  if (outcome == farm::v1::OUTCOME_CONFLICT || outcome == farm::v1::OUTCOME_REJECTED)
    shared_.log.warn("a result was refused", attributes);
  else
    shared_.log.debug("a result was answered", attributes);
}

}  // namespace metrofarm::rpc
