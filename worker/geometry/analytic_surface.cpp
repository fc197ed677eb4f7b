#include "geometry/analytic_surface.h"

#include <xsimd/xsimd.hpp>

namespace metrofarm::geometry {
namespace {

constexpr float kInvTwoPi = 0.5F * kInvPi;

// The record of an analytic shape (see Primitives::analytic).
struct Record {
  const float* table;
  Int base;
  Mask lanes;

  Float number(int k) const { return gather(table + k, base, lanes); }
  Vec3 vector(int k) const { return {number(k), number(k + 1), number(k + 2)}; }
};

Record record_of(const Primitives& p, Int primitive, Mask lanes) {
  return {p.analytic.data(), (primitive - Int(p.triangle_count)) * Int(kAnalyticStride), lanes};
}

// Azimuth in turns, in [0, 1]; 0 on the axis.
Float turns_of(Float x, Float y) {
  const Mask on_axis = (x == Float(0.F)) & (y == Float(0.F));
  const Float turns = xsimd::atan2(y, select(on_axis, Float(1.F), x)) * Float(kInvTwoPi);
  return select(turns < Float(0.F), turns + Float(1.F), turns);
}

struct Patch {
  Vec3 position, normal;
  Float offset;
  Vec2 uv;
  Vec3 dp_du, dp_dv;
};

// u = phi / 2 pi, v = theta / pi.
void parameterize_sphere(const Record& r, const Vec3& radial, Float radius, Patch& out) {
  const Vec3 axis_x = r.vector(4), axis_z = r.vector(7);
  const Vec3 axis_y = cross(axis_z, axis_x) * r.number(10);
  const Float x = dot(radial, axis_x), y = dot(radial, axis_y), z = dot(radial, axis_z);
  const Float ring = xsimd::sqrt(x * x + y * y);  // sin theta
  out.uv = {turns_of(x, y), xsimd::atan2(ring, z) * Float(kInvPi)};
  const Mask pole = ring == Float(0.F);
  const Float inverse = Float(1.F) / select(pole, Float(1.F), ring);
  const Float cos_phi = x * inverse, sin_phi = y * inverse;
  out.dp_du = (axis_y * x - axis_x * y) * (radius * Float(2 * kPi));
  // Every azimuth leads to the poles; it is taken for 0 there.
  const Vec3 outwards = select(pole, axis_x, axis_x * cos_phi + axis_y * sin_phi);
  out.dp_dv = (outwards * select(pole, Float(1.F), z) - axis_z * ring) * (radius * Float(kPi));
}

Patch sphere_at(const Record& r, const Vec3& end, bool parameters) {
  const Vec3 center = r.vector(0);
  const Float radius = r.number(3);
  Patch out;
  // Back onto the sphere: the ray's end carries an error that grows with its length.
  out.normal = normalize(end - center);
  out.position = center + out.normal * radius;
  out.offset = (max_component(abs(center)) + radius) * Float(kOffsetScale);
  if (parameters) parameterize_sphere(r, out.normal, radius, out);
  return out;
}

// u = radius, v = phi / 2 pi.
Patch disk_at(const Record& r, const Vec3& end, bool parameters) {
  const Vec3 center = r.vector(0), axis_x = r.vector(3), axis_y = r.vector(6);
  const Vec3 normal = cross(axis_x, axis_y);
  Patch out;
  out.normal = normalize(normal);
  out.position = end - out.normal * dot(end - center, out.normal);
  const Float extent = max_component(abs(axis_x)) + max_component(abs(axis_y));
  out.offset = (max_component(abs(center)) + extent) * Float(kOffsetScale);
  if (!parameters) return out;
  const Vec3 in_plane = out.position - center;
  const Float scale = Float(1.F) / dot(normal, normal);
  const Float x = dot(cross(in_plane, axis_y), normal) * scale;
  const Float y = dot(cross(axis_x, in_plane), normal) * scale;
  const Float radius = xsimd::sqrt(x * x + y * y);
  const Mask center_hit = radius == Float(0.F);
  const Float inverse = Float(1.F) / select(center_hit, Float(1.F), radius);
  out.uv = {radius, turns_of(x, y)};
  out.dp_du = axis_x * select(center_hit, Float(1.F), x * inverse) + axis_y * (y * inverse);
  out.dp_dv = (axis_y * x - axis_x * y) * Float(2 * kPi);
  return out;
}

Float cylinder_offset(const Vec3& center, const Vec3& axis_x, const Vec3& axis_y,
                      const Vec3& axis_z) {
  return max_component(abs(center) + abs(axis_x) + abs(axis_y) + abs(axis_z)) * Float(kOffsetScale);
}

// u = phi / 2 pi, v = height.
Patch cylinder_at(const Record& r, const Vec3& end, bool parameters) {
  const Vec3 center = r.vector(0), axis_x = r.vector(3), axis_y = r.vector(6);
  const Vec3 axis_z = r.vector(9);
  const Vec3 from_center = end - center;
  const Float height = dot(from_center, axis_z) / dot(axis_z, axis_z);
  Patch out;
  out.normal = normalize(from_center - axis_z * height);
  const Vec3 radial = out.normal * length(axis_x);
  out.position = center + axis_z * height + radial;
  out.offset = cylinder_offset(center, axis_x, axis_y, axis_z);
  if (!parameters) return out;
  const Float inverse = Float(1.F) / dot(axis_x, axis_x);
  const Float x = dot(radial, axis_x) * inverse, y = dot(radial, axis_y) * inverse;
  out.uv = {turns_of(x, y), height};
  out.dp_du = (axis_y * x - axis_x * y) * Float(2 * kPi);
  out.dp_dv = axis_z;
  return out;
}

void blend(const Patch& patch, SurfaceNeeds needs, Mask lanes, Surface& s) {
  s.position = select(lanes, patch.position, s.position);
  s.geometric_normal = select(lanes, patch.normal, s.geometric_normal);
  s.shading_normal = select(lanes, patch.normal, s.shading_normal);
  s.offset = select(lanes, patch.offset, s.offset);
  if (needs.uv) {
    s.point.uv.x = select(lanes, patch.uv.x, s.point.uv.x);
    s.point.uv.y = select(lanes, patch.uv.y, s.point.uv.y);
  }
  if (needs.tangents) {
    s.dp_du = select(lanes, patch.dp_du, s.dp_du);
    s.dp_dv = select(lanes, patch.dp_dv, s.dp_dv);
  }
}

}  // namespace

void fill_analytic(const Primitives& p, const RayHits& hits, const Vec3& ray_end,
                   SurfaceNeeds needs, Mask lanes, Surface& s) {
  const Int kind = gather(p.analytic_kind.data(), hits.primitive - Int(p.triangle_count), lanes);
  const bool parameters = needs.uv || needs.tangents;
  using Evaluate = Patch (*)(const Record&, const Vec3&, bool);
  constexpr Evaluate kEvaluate[] = {sphere_at, disk_at, cylinder_at};  // by AnalyticKind
  for (int k = 0; k < 3; ++k) {
    const Mask mine = lanes & equal(kind, Int(k));
    if (none(mine)) continue;
    blend(kEvaluate[k](record_of(p, hits.primitive, mine), ray_end, parameters), needs, mine, s);
  }
}

TrianglePoint point_on_cylinder(const Primitives& p, Int primitive, Vec2 uv, Mask lanes) {
  const Record r = record_of(p, primitive, lanes);
  const Vec3 center = r.vector(0), axis_x = r.vector(3), axis_y = r.vector(6);
  const Vec3 axis_z = r.vector(9);
  const SinCos a = sincos_turn(uv.x);
  const Vec3 radial = axis_x * a.cos + axis_y * a.sin;
  return {center + radial + axis_z * uv.y, normalize(radial),
          cylinder_offset(center, axis_x, axis_y, axis_z)};
}

}  // namespace metrofarm::geometry
