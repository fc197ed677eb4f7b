// Areas and bounds of primitives.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "geometry/analytic.h"
#include "geometry/hull.h"
#include "geometry/placements.h"

namespace metrofarm::geometry {
namespace {

struct Double3 {
  double x, y, z;
};

double cross_length(Double3 a, Double3 b) {
  return std::hypot(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

double triangle_area(const std::vector<float>& positions, const int32_t* corners) {
  const float* a = &positions[3 * size_t(corners[0])];
  const float* b = &positions[3 * size_t(corners[1])];
  const float* c = &positions[3 * size_t(corners[2])];
  return 0.5 * cross_length({double(b[0]) - a[0], double(b[1]) - a[1], double(b[2]) - a[2]},
                            {double(c[0]) - a[0], double(c[1]) - a[1], double(c[2]) - a[2]});
}

constexpr float kInfinity = std::numeric_limits<float>::infinity();

}  // namespace

Bounds no_bounds() {
  return {{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
}

void include(Bounds& bounds, int axis, float low, float high) {
  bounds.lower[axis] = std::min(bounds.lower[axis], low);
  bounds.upper[axis] = std::max(bounds.upper[axis], high);
}

void include(Bounds& bounds, const Bounds& box) {
  for (int k = 0; k < 3; ++k) include(bounds, k, box.lower[k], box.upper[k]);
}

double reach_of(const Bounds& box) {
  double reach = 0;
  for (int k = 0; k < 3; ++k)
    reach = std::hypot(reach, std::max(std::fabs(box.lower[k]), std::fabs(box.upper[k])));
  return reach;
}

void include_mapped(Bounds& bounds, const Bounds& box, const float* map) {
  for (int k = 0; k < 3; ++k) {
    const float* row = map + size_t{4} * k;
    double low = row[3];
    double high = row[3];
    double terms = std::fabs(double(row[3]));
    for (int j = 0; j < 3; ++j) {
      const double a = double(row[j]) * box.lower[j];
      const double b = double(row[j]) * box.upper[j];
      low += std::min(a, b);
      high += std::max(a, b);
      terms += std::max(std::fabs(a), std::fabs(b));
    }
    const double slack = 1e-6 * terms;  // rays are carried in single precision
    include(bounds, k, static_cast<float>(low - slack), static_cast<float>(high + slack));
  }
}

Bounds bounds_of(const Primitives& p, const PrimitiveRange& range) {
  Bounds bounds = no_bounds();
  const int32_t* indices = p.indices.data() + 3 * size_t(range.first_triangle);
  for (size_t i = 0; i < 3 * size_t(range.triangle_count); ++i) {
    const float* v = &p.positions[3 * size_t(indices[i])];
    for (int k = 0; k < 3; ++k) include(bounds, k, v[k], v[k]);
  }
  if (range.deforming >= 0) {
    for (const scene::VertexKey& key : p.deforming[static_cast<size_t>(range.deforming)].keys) {
      for (size_t i = 0; i < key.positions.size(); ++i)
        include(bounds, static_cast<int>(i % 3), key.positions[i], key.positions[i]);
    }
  }
  for (int32_t i = 0; i < range.analytic_count; ++i) {
    include(bounds, bounds_of_analytic(p, static_cast<uint32_t>(range.first_analytic + i)));
  }
  return bounds;
}

double area_of(const Primitives& p, uint32_t primitive) {
  if (primitive < static_cast<uint32_t>(p.triangle_count))
    return triangle_area(p.positions, &p.indices[3 * size_t{primitive}]);
  const uint32_t i = primitive - static_cast<uint32_t>(p.triangle_count);
  const float* a = &p.analytic[size_t{i} * kAnalyticStride];
  switch (static_cast<AnalyticKind>(p.analytic_kind[i])) {
    case AnalyticKind::kSphere:
      return 4 * std::numbers::pi * double(a[3]) * a[3];
    case AnalyticKind::kDisk:
      return std::numbers::pi * cross_length({a[3], a[4], a[5]}, {a[6], a[7], a[8]});
    case AnalyticKind::kCylinder:
      return 2 * std::numbers::pi * cross_length({a[3], a[4], a[5]}, {a[9], a[10], a[11]});
  }
  return 0;
}

double largest_area_of(const DeformingMesh& mesh, size_t triangle) {
  double largest = 0;
  for (const scene::VertexKey& key : mesh.keys)
    largest = std::max(largest, triangle_area(key.positions, &mesh.indices[3 * triangle]));
  return largest;
}

Bounds bounds_of(const Primitives& p, const Placements& placements) {
  Bounds bounds = bounds_of(p, p.world);
  std::vector<Bounds> groups;
  for (const PrimitiveRange& group : p.groups) groups.push_back(bounds_of(p, group));
  for (size_t i = 0; i < p.instances.size(); ++i) {
    const auto group = static_cast<size_t>(p.instances[i].group);
    if (p.groups[group].empty()) continue;
    if (placements.moves(i)) {
      for (const Bounds& box : boxes_of_steps(Hull(groups[group]), placements, i))
        include(bounds, box);
    } else {
      include_mapped(bounds, groups[group], placements.matrix(i));
    }
  }
  return bounds;
}

}  // namespace metrofarm::geometry
