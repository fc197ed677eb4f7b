// Three-vectors of lanes.
#pragma once

#include "math/lanes.h"

namespace metrofarm {

struct Vec3 {
  Float x, y, z;
};

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator-(const Vec3& a) { return {-a.x, -a.y, -a.z}; }
inline Vec3 operator*(const Vec3& a, const Vec3& b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
inline Vec3 operator*(const Vec3& a, Float s) { return {a.x * s, a.y * s, a.z * s}; }
inline Vec3 operator*(Float s, const Vec3& a) { return a * s; }
inline Vec3 operator/(const Vec3& a, Float s) { return a * (Float(1.F) / s); }

inline Float dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Float length_squared(const Vec3& a) { return dot(a, a); }
inline Float length(const Vec3& a) { return xsimd::sqrt(dot(a, a)); }
inline Vec3 normalize(const Vec3& a) { return a * (Float(1.F) / length(a)); }

inline Vec3 select(Mask m, const Vec3& a, const Vec3& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}
inline Vec3 keep(Mask m, const Vec3& a) { return {keep(m, a.x), keep(m, a.y), keep(m, a.z)}; }
inline Vec3 splat(float x, float y, float z) { return {Float(x), Float(y), Float(z)}; }
inline Vec3 splat(float v) { return {Float(v), Float(v), Float(v)}; }
inline Float max_component(const Vec3& a) { return xsimd::max(a.x, xsimd::max(a.y, a.z)); }
inline Vec3 abs(const Vec3& a) { return {xsimd::abs(a.x), xsimd::abs(a.y), xsimd::abs(a.z)}; }

// table[3 * index + 0..2] per lane.
inline Vec3 gather3(const float* table, Int index, Mask m) {
  const Int i = index * Int(3);
  return {gather(table, i, m), gather(table + 1, i, m), gather(table + 2, i, m)};
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
