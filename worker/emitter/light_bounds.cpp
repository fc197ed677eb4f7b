#include "emitter/light_bounds.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace metrofarm::emitter {
namespace {

constexpr double kPiDouble = std::numbers::pi;

double dot(const Double3& a, const Double3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double angle_of(double cosine) {
  return std::acos(std::clamp(cosine, -1.0, 1.0));
}

Double3 scaled(const Double3& v, double s) {
  return {v[0] * s, v[1] * s, v[2] * s};
}

Double3 sum(const Double3& a, const Double3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

// A unit vector, or all zero where there is no direction.
Double3 unit(const Double3& v) {
  const double length = std::hypot(v[0], v[1], v[2]);
  return length > 0 && std::isfinite(length) ? scaled(v, 1 / length) : Double3{};
}

}  // namespace

Cone cone_around(const Cone& a, const Cone& b) {
  const double angle_a = angle_of(a.cosine), angle_b = angle_of(b.cosine);
  const double between = angle_of(dot(a.axis, b.axis));
  if (between + angle_b <= angle_a) return a;
  if (between + angle_a <= angle_b) return b;
  const double angle = (angle_a + between + angle_b) / 2;
  if (angle >= kPiDouble) return {a.axis, kAllDirections};
  // The axis lies on the arc from a's to b's: what of b is at right angles to a leads there.
  const Double3 across = unit(sum(b.axis, scaled(a.axis, -dot(a.axis, b.axis))));
  if (dot(across, across) == 0) return {a.axis, kAllDirections};
  const double turn = angle - angle_a;
  return {unit(sum(scaled(a.axis, std::cos(turn)), scaled(across, std::sin(turn)))),
          std::cos(angle)};
}

Cone cone_around(const std::array<Double3, 3>& directions) {
  Double3 middle{};
  for (const Double3& d : directions) middle = sum(middle, unit(d));
  Cone cone{unit(middle), 1};
  for (const Double3& d : directions) cone.cosine = std::min(cone.cosine, dot(cone.axis, unit(d)));
  if (!(cone.cosine > 0)) return {{0, 0, 1}, kAllDirections};
  return cone;
}

LightBounds bounds_of(const LightBounds& a, const LightBounds& b) {
  LightBounds both;
  for (int k = 0; k < 3; ++k) {
    both.lower[k] = std::min(a.lower[k], b.lower[k]);
    both.upper[k] = std::max(a.upper[k], b.upper[k]);
  }
  both.intensity = a.intensity + b.intensity;
  both.normals = cone_around(a.normals, b.normals);
  both.cos_spread = std::min(a.cos_spread, b.cos_spread);
  return both;
}

double lit_solid_angle(const LightBounds& bounds) {
  const double angle = angle_of(bounds.normals.cosine);
  const double edge = std::min(angle + angle_of(bounds.cos_spread), kPiDouble);
  const double sine = std::sin(angle);
  return 2 * kPiDouble * (1 - std::cos(angle)) +
         kPiDouble / 2 *
             (2 * edge * sine - std::cos(angle - 2 * edge) - 2 * angle * sine + std::cos(angle));
}

bool usable(const LightBounds& bounds) {
  double size = 0;
  for (int k = 0; k < 3; ++k) size += std::fabs(bounds.lower[k]) + std::fabs(bounds.upper[k]);
  return std::isfinite(size) && std::isfinite(bounds.intensity) && bounds.intensity > 0;
}

}  // namespace metrofarm::emitter
