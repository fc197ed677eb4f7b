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
  const double root = std::sqrt(discriminant);
  const double q = -(b + std::copysign(root, b));
  const double c = dot(oc, oc) - radius2;
  const double first = q / a;
  const double second = q != 0 ? c / q : first;
  return nearest_inside(std::fmin(first, second), std::fmax(first, second), ray);
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

}  // namespace

double intersect_analytic(const Primitives& p, uint32_t index, const RaySegment& ray) {
  const float* data = &p.analytic[size_t{index} * kAnalyticStride];
  const bool sphere = p.analytic_kind[index] == static_cast<int32_t>(AnalyticKind::kSphere);
  return sphere ? intersect_sphere(data, ray) : intersect_disk(data, ray);
}

Bounds bounds_of_analytic(const Primitives& p, uint32_t index) {
  const float* d = &p.analytic[size_t{index} * kAnalyticStride];
  const bool sphere = p.analytic_kind[index] == static_cast<int32_t>(AnalyticKind::kSphere);
  Bounds bounds;
  for (int k = 0; k < 3; ++k) {
    const float extent = sphere ? d[3] : std::hypot(d[3 + k], d[6 + k]);
    const float slack = 1e-6F * (std::fabs(d[k]) + extent);
    bounds.lower[k] = d[k] - extent - slack;
    bounds.upper[k] = d[k] + extent + slack;
  }
  return bounds;
}

}  // namespace metrofarm::geometry
