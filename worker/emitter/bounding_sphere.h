// A sphere around everything that can be lit.
#pragma once

#include <numbers>

#include "geometry/placements.h"
#include "math/warp.h"

namespace metrofarm::emitter {

struct BoundingSphere {
  double center[3] = {0, 0, 0};
  double radius = 1;

  // Where a ray starts that reaches the scene along `direction` (unit): uniform on the disk across
  // it that covers the sphere, before anything in the scene. pdf_area = 1 / disk_area().
  Vec3 point_before(const Vec3& direction, Vec2 u) const;
  float disk_area() const { return static_cast<float>(std::numbers::pi * radius * radius); }
};

// Around the scene's box, as Mitsuba's; of radius 1 where there is nothing.
BoundingSphere bounding_sphere(const geometry::Primitives& primitives,
                               const geometry::Placements& placements);

}  // namespace metrofarm::emitter
