// The part of an emitter's to_world that turns directions.
#pragma once

#include <array>
#include <cmath>

#include "base/check.h"
#include "scene/description.h"

namespace metrofarm::emitter {

using LinearMap = std::array<double, 9>;  // row major

inline LinearMap linear_part(const scene::Matrix& m) {
  return {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
}

inline double determinant(const LinearMap& m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
         m[2] * (m[3] * m[7] - m[4] * m[6]);
}

// The linear part scaled to a determinant of 1 or -1: a uniform scale has no meaning for lights.
// Requires: it is invertible, which importers have made sure of.
inline LinearMap turn(const scene::Matrix& to_world) {
  LinearMap m = linear_part(to_world);
  const double size = std::cbrt(std::fabs(determinant(m)));
  METROFARM_CHECK(size > 0);
  for (double& v : m) v /= size;
  return m;
}

inline LinearMap inverse_turn(const scene::Matrix& to_world) {
  const LinearMap m = turn(to_world);
  const double d = determinant(m);  // 1 or -1
  return {(m[4] * m[8] - m[5] * m[7]) / d, (m[2] * m[7] - m[1] * m[8]) / d,
          (m[1] * m[5] - m[2] * m[4]) / d, (m[5] * m[6] - m[3] * m[8]) / d,
          (m[0] * m[8] - m[2] * m[6]) / d, (m[2] * m[3] - m[0] * m[5]) / d,
          (m[3] * m[7] - m[4] * m[6]) / d, (m[1] * m[6] - m[0] * m[7]) / d,
          (m[0] * m[4] - m[1] * m[3]) / d};
}

}  // namespace metrofarm::emitter
