// Three-vectors of lanes.
#pragma once

#include "math/lanes.h"

namespace metrofarm {

struct Vec3 {
  Float x, y, z;
};

inline Vec3 operator+(const Vec3& a, const Vec3& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Vec3 operator-(const Vec3& a, const Vec3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Vec3 operator-(const Vec3& a) {
  return {-a.x, -a.y, -a.z};
}
inline Vec3 operator*(const Vec3& a, const Vec3& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}
inline Vec3 operator*(const Vec3& a, Float s) {
  return {a.x * s, a.y * s, a.z * s};
}
inline Vec3 operator*(Float s, const Vec3& a) {
  return a * s;
}
inline Vec3 operator/(const Vec3& a, Float s) {
  return a * (Float(1.F) / s);
}

inline Float dot(const Vec3& a, const Vec3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Float length_squared(const Vec3& a) {
  return dot(a, a);
}
inline Float length(const Vec3& a) {
  return xsimd::sqrt(dot(a, a));
}
inline Vec3 normalize(const Vec3& a) {
  return a * (Float(1.F) / length(a));
}

inline Vec3 select(Mask m, const Vec3& a, const Vec3& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}
inline Vec3 keep(Mask m, const Vec3& a) {
  return {keep(m, a.x), keep(m, a.y), keep(m, a.z)};
}
inline Vec3 splat(float x, float y, float z) {
  return {Float(x), Float(y), Float(z)};
}
inline Vec3 splat(float v) {
  return {Float(v), Float(v), Float(v)};
}
inline Float max_component(const Vec3& a) {
  return xsimd::max(a.x, xsimd::max(a.y, a.z));
}
inline Vec3 abs(const Vec3& a) {
  return {xsimd::abs(a.x), xsimd::abs(a.y), xsimd::abs(a.z)};
}

// table[3 * index + 0..2] per lane; 0 outside m. The table ends with spare floats: eight
// four-wide loads and a transpose take about half the time of three gathers (Zen 4).
inline Vec3 gather3(const float* table, Int index, Mask m) {
  const __m256i masked = _mm256_and_si256(index, _mm256_castps_si256(m));
  alignas(32) int32_t i[kLanes];
  _mm256_store_si256(reinterpret_cast<__m256i*>(i), Int(masked) * Int(3));
  const auto rows = [&](int low, int high) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(table + i[low])),
                                _mm_loadu_ps(table + i[high]), 1);
  };
  const __m256 r0 = rows(0, 4), r1 = rows(1, 5), r2 = rows(2, 6), r3 = rows(3, 7);
  const __m256 xy01 = _mm256_unpacklo_ps(r0, r1), z01 = _mm256_unpackhi_ps(r0, r1);
  const __m256 xy23 = _mm256_unpacklo_ps(r2, r3), z23 = _mm256_unpackhi_ps(r2, r3);
  return {keep(m, _mm256_shuffle_ps(xy01, xy23, 0x44)),
          keep(m, _mm256_shuffle_ps(xy01, xy23, 0xee)), keep(m, _mm256_shuffle_ps(z01, z23, 0x44))};
}

// An orthonormal basis; n is the third axis. Requires: n is a unit vector.
struct Frame {
  Vec3 s, t, n;

  Vec3 to_world(const Vec3& v) const { return s * v.x + t * v.y + n * v.z; }
  Vec3 to_local(const Vec3& v) const { return {dot(v, s), dot(v, t), dot(v, n)}; }
};

// Duff et al. 2017, "Building an Orthonormal Basis, Revisited", listing 3.
inline Frame frame_around(const Vec3& n) {
  const Float sign = xsimd::copysign(Float(1.F), n.z);
  const Float a = Float(-1.F) / (sign + n.z);
  const Float b = n.x * n.y * a;
  return {{Float(1.F) + sign * n.x * n.x * a, sign * b, -sign * n.x},
          {b, sign + n.y * n.y * a, -n.y},
          n};
}

}  // namespace metrofarm
