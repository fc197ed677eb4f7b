#include "rpc/fleet.h"

#include <algorithm>
#include <chrono>

#include "rpc/metrics.h"

namespace metrofarm::rpc {

namespace {
// Then results for a coordinator that is away may not keep the worker from serving others.
constexpr double kHopelessSeconds = 3;
}  // namespace

Fleet::Fleet(FleetOptions options, const Shared& shared)
    : options_(std::move(options)), shared_(shared) {}

Fleet::~Fleet() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
  stop_leasing();
}

void Fleet::start() {
  thread_ = std::thread([this] { look_up_until_stopped(); });
}

void Fleet::look_up_until_stopped() {
  // The links' states are published more often than names are looked up.
  constexpr double kPublishSeconds = 0.5;
  for (double due = 0;; due -= kPublishSeconds) {
    if (due <= 0) {
      look_up();
      due = options_.resolve_seconds;
    }
    publish();
    std::unique_lock lock(mutex_);
    wake_.wait_for(lock, std::chrono::duration<double>(kPublishSeconds), [&] { return stopping_; });
    if (stopping_) return;
  }
}

void Fleet::look_up() {
  std::map<std::string, std::set<Endpoint>> found;
  for (const HostPort& name : options_.coordinators) {
    auto endpoints = options_.resolve(name);  // may take seconds
    if (endpoints.ok()) {
      found[name.to_string()] = std::move(endpoints.value());
      unresolved_.erase(name.to_string());
    } else if (unresolved_.insert(name.to_string()).second) {
      shared_.log.warn(
          "cannot look up a coordinator",
          {{"server.address", name.to_string()}, {"error.message", endpoints.error().message}});
    }
  }
  const std::lock_guard lock(mutex_);
  if (stopping_) return;
  retire_gone(found);
  retire_doubles();
  for (const auto& [name, endpoints] : found) {
    for (const Endpoint& endpoint : endpoints) {
      if (links_.contains(endpoint) || doubles_.contains(endpoint)) continue;
      auto link =
          std::make_shared<Link>(endpoint, options_.credentials, options_.identity, shared_);
      link->start();
      links_.emplace(endpoint, std::move(link));
    }
  }
}

// A name that cannot be looked up says nothing about its endpoints. Requires: mutex_.
void Fleet::retire_gone(const std::map<std::string, std::set<Endpoint>>& found) {
  for (auto it = links_.begin(); it != links_.end();) {
    const auto name = found.find(it->first.name);
    if (name == found.end() || name->second.contains(it->first)) {
      ++it;
      continue;
    }
    shared_.log.info("a coordinator is gone", {{"server.address", it->first.address}});
    it->second->stop_leasing();
    retired_.push_back(std::move(it->second));
    it = links_.erase(it);
  }
  std::erase_if(retired_, [](const std::shared_ptr<Link>& link) { return link->finished(); });
  std::erase_if(doubles_, [&](const Endpoint& endpoint) {
    const auto name = found.find(endpoint.name);
    return name != found.end() && !name->second.contains(endpoint);
  });
}

// Two addresses may lead to one coordinator. Requires: mutex_.
void Fleet::retire_doubles() {
  // The address that was kept may be the one that no longer works.
  if (std::any_of(links_.begin(), links_.end(),
                  [](const auto& l) { return !l.second->connected(); }))
    doubles_.clear();
  std::set<std::string> seen;
  for (auto it = links_.begin(); it != links_.end();) {
    const std::string id = it->second->client().coordinator_id();
    if (id.empty() || seen.insert(id).second) {
      ++it;
      continue;
    }
    shared_.log.info("another address of a coordinator that is known",
                     {{"server.address", it->first.address}});
    it->second->stop_leasing();
    doubles_.insert(it->first);
    retired_.push_back(std::move(it->second));
    it = links_.erase(it);
  }
}

void Fleet::stop_leasing() {
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  for (const auto& [endpoint, link] : links_) link->stop_leasing();
}

void Fleet::leave() {
  std::vector<std::shared_ptr<Link>> all;
  {
    const std::lock_guard lock(mutex_);
    all = retired_;
    for (const auto& [endpoint, link] : links_) all.push_back(link);
  }
  std::vector<std::jthread> threads;
  for (const auto& link : all) threads.emplace_back([link] { link->leave(); });
}

size_t Fleet::connected() const {
  const std::lock_guard lock(mutex_);
  return static_cast<size_t>(std::count_if(links_.begin(), links_.end(),
                                           [](const auto& l) { return l.second->connected(); }));
}

size_t Fleet::leases() const {
  const std::lock_guard lock(mutex_);
  size_t n = 0;
  for (const auto& [endpoint, link] : links_) n += link->leases().count();
  for (const auto& link : retired_) n += link->leases().count();
  return n;
}

bool Fleet::drain_requested() const {
  const std::lock_guard lock(mutex_);
  return std::any_of(links_.begin(), links_.end(),
                     [](const auto& l) { return l.second->drain_requested(); });
}

bool Fleet::hopeless(const Link* link) const {
  const std::lock_guard lock(mutex_);
  bool lost = false, others = false;
  const auto look = [&](Link& one) {
    const double away = one.client().away_seconds();
    if (&one == link) lost = away >= kHopelessSeconds;
    if (&one != link && away == 0) others = true;
  };
  for (const auto& [endpoint, one] : links_) look(*one);
  for (const auto& one : retired_) look(*one);
  return lost && others;
}

void Fleet::publish() const {
  size_t known = 0;
  {
    const std::lock_guard lock(mutex_);
    known = links_.size();
  }
  shared_.metrics.coordinators(known, connected());
  shared_.metrics.leases(leases());
  shared_.metrics.parcels(shared_.outbox.size());
}

}  // namespace metrofarm::rpc
