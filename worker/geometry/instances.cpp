#include "geometry/instances.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "scene/linear.h"

namespace metrofarm::geometry {
namespace {

constexpr int kNormalMatrix = 12;  // columns of Primitives::instances
constexpr int kOffsetFactor = 21;
constexpr int kOffsetShift = 22;

double largest_row(const scene::Linear& m) {
  double largest = 0;
  for (size_t r = 0; r < 3; ++r)
    largest =
        std::max(largest, std::fabs(m[3 * r]) + std::fabs(m[3 * r + 1]) + std::fabs(m[3 * r + 2]));
  return largest;
}

// By how much going to the group's space and back can spread rounding errors: the row norm of
// |M| |M^-1| (Skeel's condition number), which is up to 3 for rotations and covered by
// kOffsetScale that far.
double error_spread(const scene::Linear& m, const scene::Linear& normals) {
  scene::Linear product = {};
  for (int i = 0; i < 9; ++i) {
    for (int k = 0; k < 3; ++k)
      product[i] += std::fabs(m[3 * (i / 3) + k]) * std::fabs(normals[3 * (i % 3) + k]);
  }
  return std::max(1.0, largest_row(product) / 3);
}

struct Columns {
  const Primitives& p;
  Int base;
  Mask lanes;
  Float operator()(int k) const { return gather(p.instances.data() + k, base, lanes); }
};

Vec3 multiply(const Columns& c, int first, int row_stride, const Vec3& v) {
  const auto row = [&](int r) {
    const int k = first + r * row_stride;
    return c(k) * v.x + c(k + 1) * v.y + c(k + 2) * v.z;
  };
  return {row(0), row(1), row(2)};
}

Vec3 multiply_transposed(const Columns& c, int first, const Vec3& v) {
  const auto column = [&](int k) {
    return c(first + k) * v.x + c(first + k + 3) * v.y + c(first + k + 6) * v.z;
  };
  return {column(0), column(1), column(2)};
}

Vec3 translation(const Columns& c) {
  return {c(3), c(7), c(11)};
}

Columns columns_of(const Primitives& p, Int instance, Mask lanes) {
  return {p, instance * Int(kInstanceStride), lanes};
}

}  // namespace

void append_instance(const scene::Matrix& m, std::vector<float>& table) {
  const size_t end = table.size() + kInstanceStride;
  const scene::Linear linear = scene::linear_part(m);
  METROFARM_CHECK(scene::determinant(linear) != 0);
  const scene::Linear normals = scene::inverse_transpose(linear);
  const double spread = error_spread(linear, normals);
  const double shift = std::max({std::fabs(m[3]), std::fabs(m[7]), std::fabs(m[11])});
  for (int i = 0; i < kNormalMatrix; ++i) table.push_back(static_cast<float>(m[i]));
  for (double v : normals) table.push_back(static_cast<float>(v));
  table.push_back(static_cast<float>(largest_row(linear) * spread));
  table.push_back(static_cast<float>(kOffsetScale * shift * spread));
  table.resize(end, 0.F);
}

LocalRay ray_in_group(const Primitives& p, Int instance, const LocalRay& ray, Mask lanes) {
  const Columns c = columns_of(p, instance, lanes);
  const Vec3 origin = multiply_transposed(c, kNormalMatrix, ray.origin - translation(c));
  const Vec3 direction = multiply_transposed(c, kNormalMatrix, ray.direction);
  return {select(lanes, origin, ray.origin), select(lanes, direction, ray.direction)};
}

void place_surface(const Primitives& p, Int instance, SurfaceNeeds needs, Mask lanes, Surface& s) {
  const Columns c = columns_of(p, instance, lanes);
  const auto normal = [&](const Vec3& n) {
    return select(lanes, normalize(multiply(c, kNormalMatrix, 3, n)), n);
  };
  s.position = select(lanes, multiply(c, 0, 4, s.position) + translation(c), s.position);
  s.geometric_normal = normal(s.geometric_normal);
  s.shading_normal = normal(s.shading_normal);
  s.offset = select(lanes, s.offset * c(kOffsetFactor) + c(kOffsetShift), s.offset);
  if (!needs.tangents) return;
  s.dp_du = select(lanes, multiply(c, 0, 4, s.dp_du), s.dp_du);
  s.dp_dv = select(lanes, multiply(c, 0, 4, s.dp_dv), s.dp_dv);
}

}  // namespace metrofarm::geometry
