// What the worker counts, for Prometheus. Names begin with metrofarm_worker_; no label holds
// anything that grows without bound.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "metrofarm/farm/v1/farm_service.pb.h"

namespace prometheus {
class Collectable;
}

namespace metrofarm::rpc {

// Thread-safe.
class Metrics {
 public:
  Metrics(const std::string& version, const std::string& isa, int threads);
  ~Metrics();

  // One batch and the segments in it; outcome: outcome_name(), or "lost" where it was given up.
  void batch(const std::string& outcome, size_t segments, uint64_t bytes);
  // Segments that were leased and not rendered: "released", "abandoned" or "failed".
  void segments_left(const std::string& outcome, size_t segments);
  void rendered(uint64_t mutations, uint64_t rays, double cpu_seconds);
  void thread_busy(int change);

  void bundle_hit();
  void bundle_missed();
  void bundle_evicted();
  void bundle_damaged();
  void bundle_bytes(uint64_t bytes);
  void loaded_scenes(size_t scenes, uint64_t bytes);

  void coordinators(size_t known, size_t connected);
  void leases(size_t held);
  void parcels(size_t waiting);

  std::shared_ptr<prometheus::Collectable> collectable() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// "committed" for OUTCOME_COMMITTED, and so on.
std::string outcome_name(farm::v1::Outcome outcome);

// Counts a thread as busy while it lives.
class BusyThread {
 public:
  explicit BusyThread(Metrics& metrics) : metrics_(metrics) { metrics_.thread_busy(1); }
  ~BusyThread() { metrics_.thread_busy(-1); }
  BusyThread(const BusyThread&) = delete;
  BusyThread& operator=(const BusyThread&) = delete;

 private:
  Metrics& metrics_;
};

}  // namespace metrofarm::rpc
