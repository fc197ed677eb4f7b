#include "geometry/analytic.h"

#include <cmath>

namespace metrofarm::geometry {
namespace {

double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void cross(const double a[3], const double b[3], double out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

double nearest_inside(double t0, double t1, const RaySegment& ray) {
  if (t0 > ray.t_near && t0 < ray.t_far) return t0;
  if (t1 > ray.t_near && t1 < ray.t_far) return t1;
  return -1;
}

// A ray's two parameters on a quadric, smaller first.
struct Crossing {
  double first, second;
};

// Solves a t^2 + 2 b t + c = 0 given the discriminant b^2 - a c, without cancellation.
Crossing solve_quadratic(double a, double b, double c, double discriminant) {
  const double q = -(b + std::copysign(std::sqrt(discriminant), b));
  const double t0 = q / a;
  const double t1 = q != 0 ? c / q : t0;
  return {std::fmin(t0, t1), std::fmax(t0, t1)};
}

double intersect_sphere(const float* s, const RaySegment& ray) {
  const double oc[3] = {ray.origin[0] - s[0], ray.origin[1] - s[1], ray.origin[2] - s[2]};
  const double a = dot(ray.direction, ray.direction);
  const double b = dot(oc, ray.direction);
  const double radius2 = double(s[3]) * s[3];
  // The discriminant from the distance of the ray's line to the center (Hearn and Baker): no
  // cancellation of b^2 against a c when the origin is far away.
  const double foot[3] = {oc[0] - b / a * ray.direction[0], oc[1] - b / a * ray.direction[1],
                          oc[2] - b / a * ray.direction[2]};
  const double discriminant = a * (radius2 - dot(foot, foot));
  if (!(discriminant >= 0)) return -1;
  const Crossing at = solve_quadratic(a, b, dot(oc, oc) - radius2, discriminant);
  return nearest_inside(at.first, at.second, ray);
}

double intersect_disk(const float* d, const RaySegment& ray) {
  const double axis_u[3] = {d[3], d[4], d[5]};
  const double axis_v[3] = {d[6], d[7], d[8]};
  double normal[3];
  cross(axis_u, axis_v, normal);
  const double slope = dot(normal, ray.direction);
  if (slope == 0) return -1;
  const double to_center[3] = {d[0] - ray.origin[0], d[1] - ray.origin[1], d[2] - ray.origin[2]};
  const double t = dot(normal, to_center) / slope;
  if (!(t > ray.t_near && t < ray.t_far)) return -1;
  const double p[3] = {t * ray.direction[0] - to_center[0], t * ray.direction[1] - to_center[1],
                       t * ray.direction[2] - to_center[2]};
  double p_cross_v[3];
  double u_cross_p[3];
  cross(p, axis_v, p_cross_v);
  cross(axis_u, p, u_cross_p);
  const double scale = 1 / dot(normal, normal);
  const double x = dot(p_cross_v, normal) * scale;
  const double y = dot(u_cross_p, normal) * scale;
  return x * x + y * y <= 1 ? t : -1;
}

// c: lower center, radii along x and y, axis; all three perpendicular.
double intersect_cylinder(const float* c, const RaySegment& ray) {
  const double from_center[3] = {ray.origin[0] - c[0], ray.origin[1] - c[1], ray.origin[2] - c[2]};
  // The ray in the space of the unit cylinder x^2 + y^2 = 1, 0 <= z <= 1.
  double o[3];
  double d[3];
  for (int k = 0; k < 3; ++k) {
    const double axis[3] = {c[3 + 3 * k], c[4 + 3 * k], c[5 + 3 * k]};
    const double scale = 1 / dot(axis, axis);
    o[k] = dot(from_center, axis) * scale;
    d[k] = dot(ray.direction, axis) * scale;
  }
  const double a = d[0] * d[0] + d[1] * d[1];
  const double b = o[0] * d[0] + o[1] * d[1];
  if (!(a > 0)) return -1;
  const double foot[2] = {o[0] - b / a * d[0], o[1] - b / a * d[1]};
  const double discriminant = a * (1 - foot[0] * foot[0] - foot[1] * foot[1]);
  if (!(discriminant >= 0)) return -1;
  const Crossing at = solve_quadratic(a, b, o[0] * o[0] + o[1] * o[1] - 1, discriminant);
  for (double t : {at.first, at.second}) {
    const double z = o[2] + t * d[2];
    if (z >= 0 && z <= 1 && t > ray.t_near && t < ray.t_far) return t;
  }
  return -1;
}

}  // namespace

double intersect_analytic(const Primitives& p, uint32_t index, const RaySegment& ray) {
  const float* data = &p.analytic[size_t{index} * kAnalyticStride];
  switch (static_cast<AnalyticKind>(p.analytic_kind[index])) {
    case AnalyticKind::kSphere:
      return intersect_sphere(data, ray);
    case AnalyticKind::kDisk:
      return intersect_disk(data, ray);
    case AnalyticKind::kCylinder:
      return intersect_cylinder(data, ray);
  }
  return -1;
}

Bounds bounds_of_analytic(const Primitives& p, uint32_t index) {
  constexpr float kIdentity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  return bounds_of_analytic(p, index, kIdentity);
}

Bounds bounds_of_analytic(const Primitives& p, uint32_t index, const float* map) {
  const float* d = &p.analytic[size_t{index} * kAnalyticStride];
  const auto kind = static_cast<AnalyticKind>(p.analytic_kind[index]);
  Bounds bounds;
  for (int k = 0; k < 3; ++k) {
    const float* row = map + size_t{4} * k;
    const auto mapped = [row](const float* v) {
      return row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
    };
    // A cylinder lies between its two end disks.
    const float extent = kind == AnalyticKind::kSphere ? d[3] * std::hypot(row[0], row[1], row[2])
                                                       : std::hypot(mapped(d + 3), mapped(d + 6));
    const float axis = kind == AnalyticKind::kCylinder ? mapped(d + 9) : 0.F;
    const float center = mapped(d) + row[3];
    const float terms = std::fabs(row[0] * d[0]) + std::fabs(row[1] * d[1]) +
                        std::fabs(row[2] * d[2]) + std::fabs(row[3]);
    const float slack = 1e-6F * (terms + extent + std::fabs(axis));
    bounds.lower[k] = center + std::fmin(axis, 0.F) - extent - slack;
    bounds.upper[k] = center + std::fmax(axis, 0.F) + extent + slack;
  }
  return bounds;
}

}  // namespace metrofarm::geometry
