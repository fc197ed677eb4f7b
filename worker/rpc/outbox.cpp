#include "rpc/outbox.h"

#include <algorithm>
#include <utility>

namespace metrofarm::rpc {

namespace {
using namespace std::chrono_literals;
constexpr auto kLookAgain = 100ms;  // whether a coordinator is away changes without notice
}  // namespace

// Requires: lock, which is given back while `hopeless` is asked: that may take other locks.
void Outbox::give_up_one(std::unique_lock<std::mutex>& lock) {
  std::vector<std::shared_ptr<Parcel>> parcels;
  for (const Place& place : places_) parcels.push_back(place.parcel);
  lock.unlock();
  for (const auto& parcel : parcels) {
    if (parcel->cancellation.cancelled()) break;  // its place is free soon
    if (!hopeless_(parcel->to)) continue;
    parcel->cancellation.cancel();
    break;
  }
  lock.lock();
}

// Requires: lock.
void Outbox::wait_for_room(std::unique_lock<std::mutex>& lock) {
  while (!closed_ && places_.size() >= kParcels) {
    give_up_one(lock);
    if (!closed_ && places_.size() >= kParcels) changed_.wait_for(lock, kLookAgain);
  }
}

bool Outbox::wait_for_room() {
  std::unique_lock lock(mutex_);
  wait_for_room(lock);
  return !closed_;
}

void Outbox::put(const Link* to, TaskResults results) {
  std::unique_lock lock(mutex_);
  wait_for_room(lock);
  if (closed_ || ended_.contains(to)) return;
  auto parcel = std::make_shared<Parcel>();
  parcel->to = to;
  parcel->results = std::move(results);
  places_.push_back({std::move(parcel), false});
  changed_.notify_all();
}

std::shared_ptr<Parcel> Outbox::take(const Link* to) {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (closed_ || ended_.contains(to)) return nullptr;
    for (Place& place : places_) {
      if (place.taken || place.parcel->to != to) continue;
      place.taken = true;
      return place.parcel;
    }
    changed_.wait(lock);
  }
}

void Outbox::done(const std::shared_ptr<Parcel>& parcel) {
  const std::lock_guard lock(mutex_);
  places_.remove_if([&](const Place& place) { return place.parcel == parcel; });
  changed_.notify_all();
}

size_t Outbox::size() const {
  const std::lock_guard lock(mutex_);
  return places_.size();
}

size_t Outbox::count_for(const Link* to) const {
  const std::lock_guard lock(mutex_);
  return static_cast<size_t>(std::count_if(
      places_.begin(), places_.end(), [&](const Place& place) { return place.parcel->to == to; }));
}

void Outbox::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  for (const Place& place : places_) place.parcel->cancellation.cancel();
  places_.remove_if([](const Place& place) { return !place.taken; });
  changed_.notify_all();
}

void Outbox::close(const Link* to) {
  const std::lock_guard lock(mutex_);
  ended_.insert(to);
  for (const Place& place : places_)
    if (place.parcel->to == to) place.parcel->cancellation.cancel();
  places_.remove_if([&](const Place& place) { return !place.taken && place.parcel->to == to; });
  changed_.notify_all();
}

void Outbox::forget(const Link* to) {
  const std::lock_guard lock(mutex_);
  ended_.erase(to);
}

}  // namespace metrofarm::rpc
