// The choke point for bad numbers: a contribution that is NaN, infinite or negative is set to zero,
// counted by kind, and kept with the primary sample that produced it. The render goes on.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "math/vec.h"

namespace metrofarm::diagnostics {

enum class AnomalyKind : uint8_t { kNan = 1, kInfinite = 2, kNegative = 3, kOutOfRange = 4 };
inline constexpr int kAnomalyKinds = 5;  // index 0 unused, as on the wire

enum class Place : uint8_t {
  kEmission,
  kEmitterSample,
  kEnvironment,
  kScattering,
  kFilm,
  kConnection,
  kCameraConnection
};
const char* name_of(Place place);

// One bad contribution, before it is known which primary sample it came from.
struct Incident {
  AnomalyKind kind = AnomalyKind::kNan;
  Place place = Place::kFilm;
  uint16_t depth = 0;  // path edges
  uint8_t lane = 0;
};

// An incident that can be replayed.
struct Anomaly {
  Incident incident;
  // Fixed-point coordinates: element 2 s and 2 s + 1 are the pair in slot s, 0 where unread.
  std::vector<uint32_t> primary_sample;
};

// Counts of everything, samples of some. Not thread-safe: one per render thread.
class AnomalyLog {
 public:
  static constexpr size_t kSamples = 16;

  void count(AnomalyKind kind) { ++counts_[static_cast<size_t>(kind)]; }
  bool wants_sample() const { return samples_.size() < kSamples; }
  void keep(Anomaly anomaly) {
    if (wants_sample()) samples_.push_back(std::move(anomaly));
  }
  void merge(const AnomalyLog& other);

  const std::array<uint64_t, kAnomalyKinds>& counts() const { return counts_; }
  const std::vector<Anomaly>& samples() const { return samples_; }

 private:
  std::array<uint64_t, kAnomalyKinds> counts_{};
  std::vector<Anomaly> samples_;
};

// Lanes whose contribution is a finite, non-negative colour.
inline Mask sound(const Vec3& c) {
  const Float zero(0.F);
  const Float largest(3.402823466e38F);
  // A comparison with NaN is false.
  return (c.x >= zero) & (c.y >= zero) & (c.z >= zero) & (c.x <= largest) & (c.y <= largest) &
         (c.z <= largest);
}

// Appends one incident per lane set in `bad`, telling the kinds apart.
void report(Mask bad, const Vec3& contribution, Place place, int depth, std::vector<Incident>& out);

}  // namespace metrofarm::diagnostics
