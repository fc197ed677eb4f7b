#include "emitter/bounding_sphere.h"

#include <cmath>

namespace metrofarm::emitter {

BoundingSphere bounding_sphere(const geometry::Primitives& primitives,
                               const geometry::Placements& placements) {
  const geometry::Bounds box = geometry::bounds_of(primitives, placements);
  BoundingSphere sphere;
  if (!(box.upper[0] >= box.lower[0])) return sphere;
  double extent[3];
  for (int k = 0; k < 3; ++k) {
    extent[k] = double(box.upper[k]) - box.lower[k];
    sphere.center[k] = 0.5 * (double(box.upper[k]) + box.lower[k]);
  }
  const double radius = 0.5 * std::hypot(extent[0], extent[1], extent[2]);
  if (radius > 0 && std::isfinite(radius)) sphere.radius = radius;
  return sphere;
}

Vec3 BoundingSphere::point_before(const Vec3& direction, Vec2 u) const {
  const Vec2 d = square_to_disk(u);
  const Frame frame = frame_around(direction);
  const Vec3 middle = splat(static_cast<float>(center[0]), static_cast<float>(center[1]),
                            static_cast<float>(center[2]));
  return middle + (frame.s * d.x + frame.t * d.y - direction) * Float(static_cast<float>(radius));
}

}  // namespace metrofarm::emitter
