// How many segments to ask for.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace metrofarm::rpc {

// How long the work of one lease should take, for a film that is collected for so long.
inline double lease_seconds(double seal_seconds) {
  // Short enough to notice soon what the coordinator wants; a round's last ones wait for it.
  return std::clamp(seal_seconds / 4, 1.5, 15.0);
}

// From how long the last ones took. Scheduling only: the image does not depend on it. Thread-safe.
class BatchSize {
 public:
  explicit BatchSize(uint32_t threads) : threads_(threads), segments_(threads) {}

  uint32_t segments() const { return segments_; }
  // So many segments took so long, and a lease should take `wanted` seconds.
  void observe(size_t segments, double seconds, double wanted) {
    const double ideal = wanted * double(segments) / std::max(seconds, 1e-3);
    // At most double at once: a quick first answer may be a cheap corner of the image.
    const double next = std::min(ideal, 2.0 * segments_);
    segments_ = static_cast<uint32_t>(std::clamp(next, double(threads_), 4096.0));
  }

 private:
  const uint32_t threads_;
  std::atomic<uint32_t> segments_;
};

}  // namespace metrofarm::rpc
