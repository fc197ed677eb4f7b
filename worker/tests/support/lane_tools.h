// Random numbers and scalar access for tests of code that works in lanes.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "math/rng.h"
#include "math/warp.h"

namespace metrofarm::test {

// A stream of uniform numbers in [0, 1), eight at a time.
class UniformLanes {
 public:
  explicit UniformLanes(uint64_t seed) : key_(rng_key(seed, RngDomain::kTest)) {}

  UInt word() { return words()[0]; }
  Float next() { return unit_float(word()); }
  Vec2 pair() {
    const RngWords w = words();
    return {unit_float(w[0]), unit_float(w[1])};
  }
  Vec3 direction() { return square_to_sphere(pair()); }

 private:
  RngWords words() {
    const UInt lane = as_uint(Int(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)));
    return philox(key_, {UInt(calls_++), lane, UInt(0U), UInt(0U)});
  }

  RngKey key_;
  uint32_t calls_ = 0;
};

using Lanes = std::array<float, kLanes>;

inline Lanes lanes_of(Float f) {
  Lanes out;
  f.store_unaligned(out.data());
  return out;
}

inline Float from_lanes(const Lanes& values) {
  return Float::load_unaligned(values.data());
}

inline bool lane_set(Mask m, int lane) {
  return (bits(m) >> lane & 1U) != 0;
}

struct Double3 {
  double x = 0, y = 0, z = 0;
};
inline Double3 operator+(Double3 a, Double3 b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Double3 operator-(Double3 a, Double3 b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Double3 operator*(Double3 a, double s) {
  return {a.x * s, a.y * s, a.z * s};
}
inline double dot(Double3 a, Double3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Double3 cross(Double3 a, Double3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(Double3 a) {
  return std::sqrt(dot(a, a));
}
inline Double3 normalize(Double3 a) {
  return a * (1 / length(a));
}

inline Double3 lane_of(const Vec3& v, int lane) {
  return {lane_value(v.x, lane), lane_value(v.y, lane), lane_value(v.z, lane)};
}
inline Vec3 splat(Double3 v) {
  return metrofarm::splat(static_cast<float>(v.x), static_cast<float>(v.y),
                          static_cast<float>(v.z));
}

// Azimuth in turns, in [0, 1).
inline double turns(double x, double y) {
  const double a = std::atan2(y, x) / (2 * std::numbers::pi);
  return a < 0 ? a + 1 : a;
}

}  // namespace metrofarm::test
