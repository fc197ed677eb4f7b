// Ray intersection of the analytic shapes, one ray at a time in double precision: a sphere's
// quadratic loses too many digits in float at a distance.
#pragma once

#include "geometry/primitives.h"

namespace metrofarm::geometry {

struct RaySegment {
  double origin[3];
  double direction[3];
  double t_near, t_far;
};

// Nearest t in (t_near, t_far) at which the ray meets analytic shape `index`; negative if none.
double intersect_analytic(const Primitives& primitives, uint32_t index, const RaySegment& ray);

Bounds bounds_of_analytic(const Primitives& primitives, uint32_t index);
// Of the shape under an affine map, 3 x 4, row major.
Bounds bounds_of_analytic(const Primitives& primitives, uint32_t index, const float* map);

}  // namespace metrofarm::geometry
