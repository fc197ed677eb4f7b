// Placements of groups: what the renderer keeps of an instance's matrix, and surfaces carried by it
// from the group's space to the world.
#pragma once

#include <vector>

#include "geometry/surface.h"

namespace metrofarm::geometry {

// Appends one instance's kInstanceStride floats (see Primitives::instances). Requires: the matrix
// is affine and not singular.
void append_instance(const scene::Matrix& to_world, std::vector<float>& table);

struct LocalRay {
  Vec3 origin, direction;
};
// The ray in the space of the group that `instance` places; the parameter t stays the same.
LocalRay ray_in_group(const Primitives& primitives, Int instance, const LocalRay& ray, Mask lanes);

// Carries surfaces to the world in these lanes.
void place_surface(const Primitives& primitives, Int instance, SurfaceNeeds needs, Mask lanes,
                   Surface& surface);

}  // namespace metrofarm::geometry
