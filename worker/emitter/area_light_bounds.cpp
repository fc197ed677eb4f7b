// What a LightTree wants to know of area lights.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "emitter/area_lights.h"
#include "geometry/analytic.h"
#include "scene/linear.h"

namespace metrofarm::emitter {
namespace {

using geometry::AnalyticKind;
using geometry::Primitives;

constexpr double kPiDouble = std::numbers::pi;

// Of half the angle that vertex normals and geometric normal fill together.
constexpr double kLeastUpright = 0.95;

Double3 three(const float* v) {
  return {v[0], v[1], v[2]};
}

Double3 cross(const Double3& a, const Double3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Double3 between(const Double3& a, const Double3& b) {
  return {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
}

double dot(const Double3& a, const Double3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Double3 turned(const Double3& v, double sign) {
  return {v[0] * sign, v[1] * sign, v[2] * sign};
}

// Vertex normals say which side radiates, the geometric normal how much. Where they lean away from
// it light leaves the back too, most of it near the horizon of the vertex normals: then the light
// is taken to shine everywhere.
Cone normals_of_triangle(const Primitives& p, const int32_t* index, const Double3& geometric,
                         size_t shape) {
  const double sign = p.normal_sign[shape];
  if (p.has_normals[shape] == 0) {
    const Double3 n = turned(geometric, sign);
    return cone_around({n, n, n});
  }
  std::array<Double3, 3> normals;
  for (int i = 0; i < 3; ++i) normals[i] = turned(three(&p.normals[3 * size_t(index[i])]), sign);
  const Cone shading = cone_around(normals);
  const double side = dot(shading.axis, geometric) < 0 ? -1 : 1;
  const Double3 n = turned(geometric, side);
  const Cone both = cone_around(shading, cone_around({n, n, n}));
  return both.cosine < kLeastUpright ? Cone{both.axis, kAllDirections} : both;
}

// The box around points that a matrix, 3 x 4, has mapped, and the cone around such normals.
void carry(LightBounds& b, const std::array<float, 12>& m) {
  const scene::Matrix whole = {m[0], m[1], m[2],  m[3],  m[4], m[5], m[6], m[7],
                               m[8], m[9], m[10], m[11], 0,    0,    0,    1};
  LightBounds carried = b;
  for (int k = 0; k < 3; ++k) {
    carried.lower[k] = carried.upper[k] = m[4 * k + 3];
    for (int j = 0; j < 3; ++j) {
      const double a0 = m[4 * k + j] * b.lower[j], a1 = m[4 * k + j] * b.upper[j];
      carried.lower[k] += std::min(a0, a1);
      carried.upper[k] += std::max(a0, a1);
    }
  }
  const scene::Linear normals = scene::inverse_transpose(scene::linear_part(whole));
  Double3 axis{};
  for (int k = 0; k < 3; ++k) {
    for (int j = 0; j < 3; ++j) axis[k] += normals[3 * k + j] * b.normals.axis[j];
  }
  carried.normals.axis = turned(axis, 1 / std::sqrt(dot(axis, axis)));
  b = carried;
}

LightBounds bounds_of_triangle(const Primitives& p, size_t triangle, size_t shape) {
  const int32_t* index = &p.indices[3 * triangle];
  Double3 corner[3];
  for (int i = 0; i < 3; ++i) corner[i] = three(&p.positions[3 * size_t(index[i])]);
  LightBounds b;
  for (int k = 0; k < 3; ++k) {
    b.lower[k] = std::min({corner[0][k], corner[1][k], corner[2][k]});
    b.upper[k] = std::max({corner[0][k], corner[1][k], corner[2][k]});
  }
  const Double3 geometric = cross(between(corner[0], corner[1]), between(corner[0], corner[2]));
  b.normals = normals_of_triangle(p, index, geometric, shape);
  return b;
}

}  // namespace

LightBounds AreaLights::bounds(int light) const {
  const auto shape = static_cast<size_t>(shape_[light]);
  const bool triangle = primitive_[light] < primitives_.triangle_count;
  LightBounds b;
  double per_intensity = kPiDouble;  // power over the greatest intensity, of what is flat
  if (triangle) {
    b = bounds_of_triangle(primitives_, static_cast<size_t>(primitive_[light]), shape);
  } else {
    const auto row = static_cast<uint32_t>(primitive_[light] - primitives_.triangle_count);
    const geometry::Bounds box = geometry::bounds_of_analytic(primitives_, row);
    b.lower = three(box.lower);
    b.upper = three(box.upper);
    b.normals.cosine = kAllDirections;
    const float* v = &primitives_.analytic[size_t{row} * geometry::kAnalyticStride];
    switch (static_cast<AnalyticKind>(primitives_.analytic_kind[row])) {
      case AnalyticKind::kSphere:
        per_intensity = 4 * kPiDouble;
        break;
      case AnalyticKind::kCylinder:
        per_intensity = kPiDouble * kPiDouble;
        break;
      case AnalyticKind::kDisk: {
        const Double3 normal =
            turned(cross(three(v + 3), three(v + 6)), primitives_.normal_sign[shape]);
        b.normals = cone_around({normal, normal, normal});
        break;
      }
    }
  }
  if (instance_[light] != scene::kNone) {
    const auto group =
        static_cast<size_t>(primitives_.instances[static_cast<size_t>(instance_[light])].group);
    if (primitives_.groups[group].deforming >= 0) {
      // Somewhere in what all of the mesh fills at all times.
      const geometry::Bounds box = geometry::bounds_of(primitives_, primitives_.groups[group]);
      b.lower = three(box.lower);
      b.upper = three(box.upper);
      b.normals.cosine = kAllDirections;
    }
  }
  if (instance_[light] != scene::kNone) b = swept(b, static_cast<size_t>(instance_[light]));
  b.intensity = powers_[light] / per_intensity;
  return b;
}

// Bounds of a light's own space wherever the instance takes them. They only guide the choice of
// lights: a cone is carried by its axis, and poses between those looked at are left out.
LightBounds AreaLights::swept(const LightBounds& own, size_t instance) const {
  constexpr int kMost = 64;
  int samples = 0;
  if (placements_.moves(instance)) {
    const int segments = placements_.step_count(instance) - 1;
    samples = std::min(4 * segments * placements_.parts(instance), kMost);
  }
  LightBounds all;
  for (int i = 0; i <= samples; ++i) {
    const float time = samples > 0 ? static_cast<float>(i) / static_cast<float>(samples) : 0.F;
    LightBounds here = own;
    carry(here, placements_.matrix_at(instance, time));
    all = i == 0 ? here : bounds_of(all, here);
  }
  return all;
}

}  // namespace metrofarm::emitter
