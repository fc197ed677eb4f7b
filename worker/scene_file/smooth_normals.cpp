#include "scene_file/smooth_normals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace metrofarm::scene_file {
namespace {

constexpr uint32_t kAbsent = std::numeric_limits<uint32_t>::max();

Point read_point(const std::vector<float>& values, size_t i) {
  return {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
}

void write_point(const Point& p, size_t i, std::vector<float>& values) {
  for (int axis = 0; axis < 3; ++axis) values[3 * i + axis] = static_cast<float>(p[axis]);
}

double angle_between(const Point& a, const Point& b) {
  return std::atan2(length(cross(a, b)), dot(a, b));
}

// A triangle's unit normal and its angles at the three corners.
struct Weights {
  Point normal;
  std::array<double, 3> angles;
};

Weights weights_of(const RawMesh& mesh, size_t triangle) {
  Point p[3];
  for (int c = 0; c < 3; ++c) p[c] = read_point(mesh.positions, mesh.indices[3 * triangle + c]);
  Weights weights;
  weights.normal = normalized(cross(subtract(p[1], p[0]), subtract(p[2], p[0])));
  for (int c = 0; c < 3; ++c) {
    weights.angles[c] =
        angle_between(subtract(p[(c + 1) % 3], p[c]), subtract(p[(c + 2) % 3], p[c]));
  }
  return weights;
}

void accumulate(const Point& normal, double weight, Point& sum) {
  for (int axis = 0; axis < 3; ++axis) sum[axis] += weight * normal[axis];
}

// Normalized, or any unit vector: nothing is seen of a vertex that no triangle with an area uses.
Point unit_or_any(const Point& sum) {
  const Point normal = normalized(sum);
  return normal == Point{0, 0, 0} ? Point{1, 0, 0} : normal;
}

// For each vertex the lowest-numbered one at the same position.
std::vector<uint32_t> weld(const RawMesh& mesh) {
  std::vector<uint32_t> order(mesh.vertex_count());
  std::iota(order.begin(), order.end(), 0U);
  const auto position = [&](uint32_t v) { return read_point(mesh.positions, v); };
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return position(a) < position(b); });
  std::vector<uint32_t> first(order.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const bool same = i > 0 && position(order[i]) == position(order[i - 1]);
    first[order[i]] = same ? first[order[i - 1]] : order[i];
  }
  return first;
}

// Splits vertices so that every corner can have its own normal; equal ones share a vertex.
class VertexSplitter {
 public:
  explicit VertexSplitter(RawMesh& mesh)
      : mesh_(mesh), next_(mesh.vertex_count(), kAbsent), used_(mesh.vertex_count(), false) {
    mesh_.normals.assign(mesh.positions.size(), 0.0F);
  }

  uint32_t vertex_with(uint32_t vertex, const std::array<float, 3>& wanted) {
    if (!used_[vertex]) {
      used_[vertex] = true;
      std::copy(wanted.begin(), wanted.end(), &mesh_.normals[3 * size_t(vertex)]);
      return vertex;
    }
    while (!std::equal(wanted.begin(), wanted.end(), &mesh_.normals[3 * size_t(vertex)])) {
      if (next_[vertex] == kAbsent) return add_copy(vertex, wanted);
      vertex = next_[vertex];
    }
    return vertex;
  }

 private:
  static void repeat(std::vector<float>& values, size_t width, uint32_t vertex) {
    if (values.empty()) return;
    for (size_t i = 0; i < width; ++i) values.push_back(values[width * vertex + i]);
  }

  uint32_t add_copy(uint32_t last, const std::array<float, 3>& normal) {
    const auto copy = static_cast<uint32_t>(mesh_.vertex_count());
    repeat(mesh_.positions, 3, last);
    repeat(mesh_.texcoords, 2, last);
    for (scene::MeshAttribute& attribute : mesh_.attributes) {
      if (!attribute.per_face) repeat(attribute.values, attribute.channels, last);
    }
    mesh_.normals.insert(mesh_.normals.end(), normal.begin(), normal.end());
    next_[last] = copy;
    next_.push_back(kAbsent);
    used_.push_back(true);
    return copy;
  }

  RawMesh& mesh_;
  std::vector<uint32_t> next_;
  std::vector<bool> used_;
};

// The triangles at one place whose normals are the same but for rounding.
struct Plane {
  Point normal;           // of one of them
  Point sum = {0, 0, 0};  // of all, weighted by angle
  std::span<const uint32_t> corners;
};

// Corners (numbered as in indices) in the order of their places.
std::vector<uint32_t> corners_by_place(const RawMesh& mesh, const std::vector<uint32_t>& place) {
  std::vector<uint32_t> corners(mesh.indices.size());
  std::iota(corners.begin(), corners.end(), 0U);
  std::stable_sort(corners.begin(), corners.end(), [&](uint32_t a, uint32_t b) {
    return place[mesh.indices[a]] < place[mesh.indices[b]];
  });
  return corners;
}

// Planes whose normals are the same in steps of 1 / steps. Sorts the corners.
std::vector<Plane> planes_of(std::span<uint32_t> corners, const std::vector<Weights>& weights,
                             double steps) {
  const auto rounded = [&](uint32_t corner) {
    Point p = weights[corner / 3].normal;
    for (double& v : p) v = std::round(v * steps);
    return p;
  };
  std::sort(corners.begin(), corners.end(), [&](uint32_t a, uint32_t b) {
    return std::pair(rounded(a), a) < std::pair(rounded(b), b);
  });
  std::vector<Plane> planes;
  for (size_t i = 0; i < corners.size(); ++i) {
    const Weights& own = weights[corners[i] / 3];
    if (i == 0 || rounded(corners[i]) != rounded(corners[i - 1])) {
      planes.push_back({own.normal, {0, 0, 0}, corners.subspan(i, 0)});
    }
    Plane& plane = planes.back();
    accumulate(own.normal, own.angles[corners[i] % 3], plane.sum);
    plane.corners = {plane.corners.data(), plane.corners.size() + 1};
  }
  return planes;
}

// Each plane is compared with each other: where very many meet, similar ones count as one.
std::vector<Plane> few_planes_of(std::span<uint32_t> corners, const std::vector<Weights>& weights) {
  constexpr size_t kMostPlanes = 4096;
  constexpr double kFewestSteps = 16;  // about 3000 planes
  double steps = 0x1p20;
  std::vector<Plane> planes = planes_of(corners, weights, steps);
  while (planes.size() > kMostPlanes && steps > kFewestSteps) {
    planes = planes_of(corners, weights, steps /= 4);
  }
  return planes;
}

std::array<float, 3> mean_near(const Plane& plane, const std::vector<Plane>& planes,
                               double least_cosine) {
  Point sum = {0, 0, 0};
  for (const Plane& other : planes) {
    if (dot(plane.normal, other.normal) >= least_cosine) {
      accumulate(other.sum, 1, sum);
    }
  }
  const Point mean = unit_or_any(sum);
  return {static_cast<float>(mean[0]), static_cast<float>(mean[1]), static_cast<float>(mean[2])};
}

}  // namespace

void complete_normals(RawMesh& mesh) {
  mesh.normals.resize(mesh.positions.size(), 0.0F);
  std::vector<bool> missing(mesh.vertex_count(), false);
  bool any = false;
  for (size_t i = 0; i < mesh.vertex_count(); ++i) {
    missing[i] = read_point(mesh.normals, i) == Point{0, 0, 0};
    any = any || missing[i];
  }
  if (!any) return;
  std::vector<Point> sums(mesh.vertex_count(), Point{0, 0, 0});
  for (size_t t = 0; 3 * t < mesh.indices.size(); ++t) {
    const Weights weights = weights_of(mesh, t);
    for (int c = 0; c < 3; ++c) {
      accumulate(weights.normal, weights.angles[c], sums[mesh.indices[3 * t + c]]);
    }
  }
  for (size_t i = 0; i < mesh.vertex_count(); ++i) {
    if (missing[i]) write_point(unit_or_any(sums[i]), i, mesh.normals);
  }
}

void smooth_up_to_angle(RawMesh& mesh, double degrees) {
  std::vector<Weights> weights;
  for (size_t t = 0; 3 * t < mesh.indices.size(); ++t) weights.push_back(weights_of(mesh, t));
  const double least_cosine = std::cos(degrees * (std::numbers::pi / 180)) - 1e-6;
  std::vector<std::array<float, 3>> normals(mesh.indices.size());
  const std::vector<uint32_t> place = weld(mesh);
  std::vector<uint32_t> corners = corners_by_place(mesh, place);
  for (size_t begin = 0, end = 0; begin < corners.size(); begin = end) {
    const uint32_t here = place[mesh.indices[corners[begin]]];
    while (end < corners.size() && place[mesh.indices[corners[end]]] == here) ++end;
    const auto planes = few_planes_of(std::span(corners).subspan(begin, end - begin), weights);
    for (const Plane& plane : planes) {
      const std::array<float, 3> normal = mean_near(plane, planes, least_cosine);
      for (uint32_t corner : plane.corners) normals[corner] = normal;
    }
  }
  VertexSplitter splitter(mesh);
  for (size_t corner = 0; corner < mesh.indices.size(); ++corner) {
    mesh.indices[corner] = splitter.vertex_with(mesh.indices[corner], normals[corner]);
  }
}

}  // namespace metrofarm::scene_file
