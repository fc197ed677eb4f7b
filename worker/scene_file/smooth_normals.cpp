#include "scene_file/smooth_normals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

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

  uint32_t vertex_with(uint32_t vertex, const Point& normal) {
    if (!used_[vertex]) {
      used_[vertex] = true;
      write_point(normal, vertex, mesh_.normals);
      return vertex;
    }
    std::array<float, 3> wanted;
    for (int axis = 0; axis < 3; ++axis) wanted[axis] = static_cast<float>(normal[axis]);
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
  const size_t triangles = mesh.indices.size() / 3;
  const std::vector<uint32_t> first = weld(mesh);
  std::vector<Weights> weights(triangles);
  // Corners (numbered as in indices) at the same position form a chain.
  std::vector<uint32_t> head(mesh.vertex_count(), kAbsent);
  std::vector<uint32_t> next(mesh.indices.size(), kAbsent);
  for (size_t t = 0; t < triangles; ++t) weights[t] = weights_of(mesh, t);
  for (size_t corner = mesh.indices.size(); corner-- > 0;) {
    uint32_t& chain = head[first[mesh.indices[corner]]];
    next[corner] = chain;
    chain = static_cast<uint32_t>(corner);
  }
  const double least_cosine = std::cos(degrees * (std::numbers::pi / 180)) - 1e-6;
  const std::vector<uint32_t> old_indices = mesh.indices;
  VertexSplitter splitter(mesh);
  for (size_t corner = 0; corner < old_indices.size(); ++corner) {
    const Point& own = weights[corner / 3].normal;
    Point sum = {0, 0, 0};
    for (uint32_t c = head[first[old_indices[corner]]]; c != kAbsent; c = next[c]) {
      const Weights& other = weights[c / 3];
      if (dot(own, other.normal) >= least_cosine) {
        accumulate(other.normal, other.angles[c % 3], sum);
      }
    }
    mesh.indices[corner] = splitter.vertex_with(old_indices[corner], unit_or_any(sum));
  }
}

}  // namespace metrofarm::scene_file
