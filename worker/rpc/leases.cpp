#include "rpc/leases.h"

#include <chrono>

namespace metrofarm::rpc {

Leases::Leases(FarmClient& client) : client_(client), thread_([this] { beat_until_stopped(); }) {}

Leases::~Leases() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  cancellation_.cancel();
  wake_.notify_all();
  thread_.join();
}

void Leases::hold(const farm::v1::Task& task) {
  const std::lock_guard lock(mutex_);
  held_[task.task_id()] = {task.epoch(), 0, false, {}};
}

void Leases::forget(const std::string& task_id) {
  const std::lock_guard lock(mutex_);
  held_.erase(task_id);
}

std::vector<farm::v1::LeaseRef> Leases::forget_all() {
  // A heartbeat after the worker has left would register it again.
  cancellation_.cancel();
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  std::vector<farm::v1::LeaseRef> refs;
  for (const auto& [task_id, held] : held_) {
    refs.emplace_back().set_task_id(task_id);
    refs.back().set_epoch(held.epoch);
  }
  held_.clear();
  return refs;
}

size_t Leases::count() const {
  const std::lock_guard lock(mutex_);
  return held_.size();
}

void Leases::set_activity(const std::string& activity) {
  const std::lock_guard lock(mutex_);
  activity_ = activity;
}

void Leases::set_fraction(const std::string& task_id, double fraction) {
  const std::lock_guard lock(mutex_);
  const auto it = held_.find(task_id);
  if (it != held_.end()) it->second.fraction = fraction;
}

bool Leases::abandoned(const std::string& task_id) const {
  const std::lock_guard lock(mutex_);
  const auto it = held_.find(task_id);
  return it != held_.end() && it->second.abandoned;
}

std::stop_token Leases::interruption(const std::string& task_id) const {
  const std::lock_guard lock(mutex_);
  const auto it = held_.find(task_id);
  return it == held_.end() ? std::stop_token() : it->second.interruption.get_token();
}

bool Leases::drain_requested() const {
  const std::lock_guard lock(mutex_);
  return drain_;
}

farm::v1::HeartbeatRequest Leases::request() const {
  farm::v1::HeartbeatRequest r;
  for (const auto& [task_id, held] : held_) {
    farm::v1::LeaseProgress* progress = r.add_leases();
    progress->mutable_lease()->set_task_id(task_id);
    progress->mutable_lease()->set_epoch(held.epoch);
    progress->set_fraction(held.fraction);
    progress->set_activity(activity_);
  }
  return r;
}

void Leases::obey(const farm::v1::HeartbeatResponse& response) {
  drain_ = drain_ || response.drain();
  for (const farm::v1::LeaseDirective& d : response.directives()) {
    const auto it = held_.find(d.lease().task_id());
    // An answer about an older lease of the same task is no word on this one.
    if (it == held_.end() || it->second.epoch != d.lease().epoch()) continue;
    const bool interrupt = d.directive() == farm::v1::DIRECTIVE_INTERRUPT;
    if (interrupt || d.directive() == farm::v1::DIRECTIVE_ABANDON) it->second.abandoned = true;
    if (interrupt) it->second.interruption.request_stop();
  }
}

void Leases::beat_until_stopped() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    wake_.wait_for(lock, std::chrono::duration<double>(client_.heartbeat_seconds()));
    if (stopping_) break;
    if (client_.worker_id().empty()) continue;  // not registered yet
    const farm::v1::HeartbeatRequest beat = request();
    lock.unlock();
    farm::v1::HeartbeatResponse response;
    const CallResult result = client_.heartbeat(beat, response, cancellation_);
    lock.lock();
    if (result == CallResult::kDone) obey(response);
  }
}

}  // namespace metrofarm::rpc
