// Motions to test with.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "motion/track.h"

namespace metrofarm::motion::test {

inline constexpr Matrix kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

inline Matrix translated(double x, double y, double z) {
  return {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1};
}
inline Matrix scaled(double x, double y, double z) {
  return {x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1};
}
inline Matrix turned(const Point& axis, double degrees) {
  return affine(to_linear(rotation_about(axis, degrees * std::numbers::pi / 180)), {0, 0, 0});
}

// A key that turns about one axis, as a file tells it, and then moves.
inline scene::Keyframe turn_key(double time, const Point& axis, double degrees,
                                const Point& to = {0, 0, 0}) {
  scene::Keyframe key{time, multiply(translated(to[0], to[1], to[2]), turned(axis, degrees))};
  key.turns = {{axis, degrees}};
  return key;
}

inline double largest_difference(const Matrix& a, const Matrix& b) {
  double largest = 0;
  for (int i = 0; i < 16; ++i) largest = std::max(largest, std::fabs(a[i] - b[i]));
  return largest;
}

}  // namespace metrofarm::motion::test
