// The surface at a hit: position, normals, and how far a new ray must start from it.
#pragma once

#include "geometry/placements.h"
#include "geometry/primitives.h"
#include "geometry/tracer.h"
#include "math/warp.h"

namespace metrofarm::geometry {

// Where a surface is looked up in textures.
struct SurfacePoint {
  Vec2 uv;        // texture coordinates; barycentric (b1, b2) on meshes without any
  Int primitive;  // for mesh attributes
  Float b1, b2;   // barycentric coordinates on triangles
};

// What a caller needs beyond position and normals.
struct SurfaceNeeds {
  bool uv = false;        // fill Surface::point
  bool tangents = false;  // fill Surface::dp_du and dp_dv
};

struct Surface {
  Vec3 position;
  Vec3 geometric_normal;  // unit; flipped where the shape says so
  Vec3 shading_normal;    // unit; interpolated where the mesh has vertex normals
  SurfacePoint point;     // filled where asked for
  Vec3 dp_du, dp_dv;      // change of the position along u and v; filled where asked for
  Float offset;           // distance within which the surface itself may be hit again
  Int shape;
};

// Fills lanes where hits.hit; the others are unspecified and may hold NaN.
Surface surface_at(const Primitives& primitives, const Placements& placements, const RayHits& hits,
                   const Vec3& origin, const Vec3& direction, SurfaceNeeds needs);

// A point of a shape, in the space of its group.
struct TrianglePoint {
  Vec3 position;
  Vec3 normal;   // unit, before flip_normals: by the winding, or outwards
  Float offset;  // see Surface
};
// The point at barycentric coordinates (b1, b2) of a triangle, at its shape's time; area, if given,
// is that of the triangle then.
TrianglePoint point_on_triangle(const Primitives& primitives, const Placements& placements,
                                Int triangle, Vec2 barycentric, Float time, Mask lanes,
                                Float* area = nullptr);
// The point at surface coordinates (u, v) of a cylinder, uniform by area where they are uniform.
TrianglePoint point_on_cylinder(const Primitives& primitives, Int primitive, Vec2 uv, Mask lanes);

// Where a ray leaves a surface towards `direction` without meeting it again.
inline Vec3 offset_origin(const Vec3& position, const Vec3& geometric_normal, Float offset,
                          const Vec3& direction) {
  const Float side = xsimd::copysign(offset, dot(geometric_normal, direction));
  return position + geometric_normal * side;
}

}  // namespace metrofarm::geometry
