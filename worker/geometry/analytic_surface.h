// The surface of spheres, disks and cylinders at a hit.
#pragma once

#include "geometry/surface.h"

namespace metrofarm::geometry {

// Fills the surface in `lanes`, where an analytic shape is hit by the ray given in its own space;
// normals before flip_normals.
void fill_analytic(const Primitives& primitives, const RayHits& hits, const Vec3& ray_end,
                   SurfaceNeeds needs, Mask lanes, Surface& surface);

}  // namespace metrofarm::geometry
