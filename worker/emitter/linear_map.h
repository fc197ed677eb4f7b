// The part of an emitter's to_world that turns directions.
#pragma once

#include <cmath>

#include "base/check.h"
#include "scene/linear.h"

namespace metrofarm::emitter {

// The linear part scaled to a determinant of 1 or -1: a uniform scale has no meaning for lights.
// Requires: it is invertible, which importers have made sure of.
inline scene::Linear turn(const scene::Matrix& to_world) {
  scene::Linear m = scene::linear_part(to_world);
  const double size = std::cbrt(std::fabs(scene::determinant(m)));
  METROFARM_CHECK(size > 0);
  for (double& v : m) v /= size;
  return m;
}

inline scene::Linear inverse_turn(const scene::Matrix& to_world) {
  return scene::inverse(turn(to_world));
}

}  // namespace metrofarm::emitter
