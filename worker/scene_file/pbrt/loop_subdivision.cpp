#include "scene_file/pbrt/loop_subdivision.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <unordered_map>

#include "scene_file/affine.h"

namespace metrofarm::scene_file::pbrt {
namespace {

struct Edge {
  uint32_t ends[2];
  uint32_t opposite[2];  // the third corners of its triangles
  int triangles = 0;     // 1 at a boundary
};

Point point_at(const std::vector<double>& values, uint32_t i) {
  return {values[3 * size_t{i}], values[3 * size_t{i} + 1], values[3 * size_t{i} + 2]};
}

void add_to(Point& sum, const Point& p, double weight) {
  for (size_t axis = 0; axis < 3; ++axis) sum[axis] += weight * p[axis];
}

void set_point(std::vector<double>& values, size_t i, const Point& p) {
  std::copy(p.begin(), p.end(), values.begin() + static_cast<std::ptrdiff_t>(3 * i));
}

// What the rules ask of a triangle mesh.
class Level {
 public:
  explicit Level(SubdivisionMesh mesh) : mesh_(std::move(mesh)) {}

  // Nothing if the mesh is a manifold with boundary, else what is wrong.
  std::optional<std::string> connect() {
    std::unordered_map<uint64_t, uint32_t> known;
    known.reserve(mesh_.indices.size());
    triangle_edges_.reserve(mesh_.indices.size());
    for (size_t i = 0; i < mesh_.indices.size(); ++i) {
      const size_t first = i - i % 3;
      const uint32_t a = mesh_.indices[i];
      const uint32_t b = mesh_.indices[first + (i + 1) % 3];
      const uint32_t c = mesh_.indices[first + (i + 2) % 3];
      if (a == b) return "a triangle names vertex " + std::to_string(a) + " twice";
      const uint64_t key = uint64_t{std::min(a, b)} << 32 | std::max(a, b);
      const auto [found, is_new] = known.emplace(key, static_cast<uint32_t>(edges_.size()));
      if (is_new) edges_.push_back({{a, b}, {0, 0}, 0});
      Edge& edge = edges_[found->second];
      if (edge.triangles == 2) {
        return "more than two triangles meet at the edge of vertices " + std::to_string(a) +
               " and " + std::to_string(b);
      }
      edge.opposite[edge.triangles++] = c;
      triangle_edges_.push_back(found->second);
    }
    gather_neighbours();
    return std::nullopt;
  }

  // Four triangles for each; vertex i stays vertex i, edge i becomes vertex count + i.
  SubdivisionMesh refine() const {
    const auto count = static_cast<uint32_t>(mesh_.vertex_count());
    SubdivisionMesh finer;
    finer.positions.resize(3 * (count + edges_.size()));
    for (uint32_t i = 0; i < count; ++i) set_point(finer.positions, i, moved_vertex(i));
    for (size_t i = 0; i < edges_.size(); ++i) {
      set_point(finer.positions, count + i, edge_point(edges_[i]));
    }
    finer.indices.reserve(4 * mesh_.indices.size());
    for (size_t t = 0; t < mesh_.indices.size(); t += 3) {
      const uint32_t* v = &mesh_.indices[t];
      const uint32_t e[3] = {count + triangle_edges_[t], count + triangle_edges_[t + 1],
                             count + triangle_edges_[t + 2]};
      finer.indices.insert(finer.indices.end(), {v[0], e[0], e[2], e[0], v[1], e[1], e[2], e[1],
                                                 v[2], e[0], e[1], e[2]});
    }
    return finer;
  }

  std::vector<double> limit_positions() const {
    std::vector<double> limit(mesh_.positions.size());
    for (uint32_t i = 0; i < mesh_.vertex_count(); ++i) {
      const double n = valence_[i];
      const double weight = is_boundary(i) ? 1.0 / 5 : 1 / (n + 3 / (8 * beta(i)));
      set_point(limit, i, masked(i, weight));
    }
    return limit;
  }

  const SubdivisionMesh& mesh() const { return mesh_; }
  SubdivisionMesh take_mesh() { return std::move(mesh_); }

 private:
  void gather_neighbours() {
    const size_t count = mesh_.vertex_count();
    valence_.assign(count, 0);
    boundary_edges_.assign(count, 0);
    sums_.assign(count, {0, 0, 0});
    boundary_sums_.assign(count, {0, 0, 0});
    for (const Edge& edge : edges_) {
      for (int end = 0; end < 2; ++end) {
        const uint32_t i = edge.ends[end];
        const Point other = point_at(mesh_.positions, edge.ends[1 - end]);
        ++valence_[i];
        add_to(sums_[i], other, 1);
        if (edge.triangles == 2) continue;
        ++boundary_edges_[i];
        add_to(boundary_sums_[i], other, 1);
      }
    }
  }

  bool is_boundary(uint32_t i) const { return boundary_edges_[i] > 0; }

  double beta(uint32_t i) const {
    return valence_[i] == 3 ? 3.0 / 16 : 3 / (8.0 * std::max(valence_[i], 1));
  }

  // The vertex with `weight` for each neighbour (at a boundary: each neighbour along it) and the
  // rest for itself.
  Point masked(uint32_t i, double weight) const {
    const bool boundary = is_boundary(i);
    const int neighbours = boundary ? boundary_edges_[i] : valence_[i];
    Point result{};
    add_to(result, point_at(mesh_.positions, i), 1 - neighbours * weight);
    add_to(result, boundary ? boundary_sums_[i] : sums_[i], weight);
    return result;
  }

  Point moved_vertex(uint32_t i) const { return masked(i, is_boundary(i) ? 1.0 / 8 : beta(i)); }

  Point edge_point(const Edge& edge) const {
    const bool boundary = edge.triangles == 1;
    Point result{};
    for (uint32_t end : edge.ends) {
      add_to(result, point_at(mesh_.positions, end), boundary ? 1.0 / 2 : 3.0 / 8);
    }
    if (boundary) return result;
    for (uint32_t corner : edge.opposite) {
      add_to(result, point_at(mesh_.positions, corner), 1.0 / 8);
    }
    return result;
  }

  SubdivisionMesh mesh_;
  std::vector<Edge> edges_;
  std::vector<uint32_t> triangle_edges_;  // of corner i and the next one
  std::vector<int> valence_;
  std::vector<int> boundary_edges_;
  std::vector<Point> sums_;
  std::vector<Point> boundary_sums_;
};

// The neighbours of every vertex in counter-clockwise order.
class Rings {
 public:
  explicit Rings(const SubdivisionMesh& mesh) : first_(mesh.vertex_count() + 1, 0) {
    for (uint32_t v : mesh.indices) ++first_[v + 1];
    for (size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    steps_.resize(mesh.indices.size());
    std::vector<size_t> at(first_.begin(), first_.end() - 1);
    for (size_t i = 0; i < mesh.indices.size(); ++i) {
      const size_t t = i - i % 3;
      steps_[at[mesh.indices[i]]++] = {mesh.indices[t + (i + 1) % 3],
                                       mesh.indices[t + (i + 2) % 3]};
    }
    for (size_t v = 0; v + 1 < first_.size(); ++v) {
      std::sort(steps_.begin() + static_cast<std::ptrdiff_t>(first_[v]),
                steps_.begin() + static_cast<std::ptrdiff_t>(first_[v + 1]), comes_before);
    }
  }

  struct Ring {
    std::vector<uint32_t> neighbours;
    bool closed = true;
  };

  // Nothing if the triangles around the vertex are no single fan with one orientation.
  std::optional<Ring> around(uint32_t vertex) const {
    const Step* begin = steps_.data() + first_[vertex];
    const Step* end = steps_.data() + first_[vertex + 1];
    Ring ring;
    if (begin == end) return ring;
    const Step* start = begin;
    std::vector<uint32_t> ends;
    for (const Step* step = begin; step != end; ++step) ends.push_back(step->to);
    std::sort(ends.begin(), ends.end());
    for (const Step* step = begin; step != end; ++step) {
      if (std::binary_search(ends.begin(), ends.end(), step->from)) continue;
      start = step;
      ring.closed = false;
    }
    uint32_t neighbour = start->from;
    for (const Step* step = start; step != end;) {
      ring.neighbours.push_back(neighbour);
      neighbour = step->to;
      if (neighbour == start->from) break;
      if (ring.neighbours.size() > static_cast<size_t>(end - begin)) return std::nullopt;
      step = std::lower_bound(begin, end, Step{neighbour, 0}, comes_before);
      if (step != end && step->from != neighbour) step = end;
    }
    if (!ring.closed) ring.neighbours.push_back(neighbour);
    const size_t used = ring.neighbours.size() - (ring.closed ? 0 : 1);
    if (used != static_cast<size_t>(end - begin)) return std::nullopt;
    return ring;
  }

 private:
  struct Step {
    uint32_t from, to;  // along a triangle's edge opposite to the vertex
  };
  static bool comes_before(const Step& a, const Step& b) { return a.from < b.from; }

  std::vector<size_t> first_;
  std::vector<Step> steps_;  // of each vertex, by `from`
};

struct Tangents {
  Point s{}, t{};
};

Tangents interior_tangents(const std::vector<Point>& ring) {
  Tangents tangents;
  for (size_t j = 0; j < ring.size(); ++j) {
    const double angle =
        2 * std::numbers::pi * static_cast<double>(j) / static_cast<double>(ring.size());
    add_to(tangents.s, ring[j], std::cos(angle));
    add_to(tangents.t, ring[j], std::sin(angle));
  }
  return tangents;
}

// s along the boundary, t across it.
Tangents boundary_tangents(const std::vector<Point>& ring, const Point& center) {
  const size_t n = ring.size();
  Tangents tangents{subtract(ring.front(), ring.back()), {}};
  if (n == 2) {
    add_to(tangents.t, ring[0], 1);
    add_to(tangents.t, ring[1], 1);
    add_to(tangents.t, center, -2);
  } else if (n == 3) {
    tangents.t = subtract(ring[1], center);
  } else if (n == 4) {
    constexpr double kWeights[4] = {-1, 2, 2, -1};
    for (size_t j = 0; j < 4; ++j) add_to(tangents.t, ring[j], kWeights[j]);
    add_to(tangents.t, center, -2);
  } else {
    const double theta = std::numbers::pi / static_cast<double>(n - 1);
    add_to(tangents.t, ring.front(), -std::sin(theta));
    add_to(tangents.t, ring.back(), -std::sin(theta));
    for (size_t j = 1; j + 1 < n; ++j) {
      const double weight = (2 * std::cos(theta) - 2) * std::sin(static_cast<double>(j) * theta);
      add_to(tangents.t, ring[j], -weight);
    }
  }
  return tangents;
}

// Of the limit surface, at limit positions.
std::optional<std::string> compute_normals(SubdivisionMesh& mesh) {
  const Rings rings(mesh);
  mesh.normals.resize(mesh.positions.size());
  std::vector<Point> points;
  for (uint32_t i = 0; i < mesh.vertex_count(); ++i) {
    const std::optional<Rings::Ring> ring = rings.around(i);
    if (!ring) return "its triangles don't form one fan of one orientation around each vertex";
    points.clear();
    for (uint32_t j : ring->neighbours) points.push_back(point_at(mesh.positions, j));
    if (points.empty()) continue;
    const Tangents tangents = ring->closed ? interior_tangents(points)
                                           : boundary_tangents(points, point_at(mesh.positions, i));
    set_point(mesh.normals, i, normalized(cross(tangents.t, tangents.s)));
  }
  return std::nullopt;
}

Error not_a_manifold(const std::string& what) {
  return Error{"the control mesh can't be subdivided: " + what};
}

}  // namespace

Result<SubdivisionMesh> subdivide(SubdivisionMesh control, int levels, uint64_t most_triangles) {
  uint64_t triangles = control.indices.size() / 3;
  for (int i = 0; i < levels; ++i) {
    triangles *= 4;
    if (triangles > most_triangles) {
      return Error{"the surface has more than " + std::to_string(most_triangles) +
                   " triangles after " + std::to_string(i + 1) + " levels; use fewer levels"};
    }
  }
  Level level(std::move(control));
  if (std::optional<std::string> problem = level.connect()) return not_a_manifold(*problem);
  for (int i = 0; i < levels; ++i) {
    level = Level(level.refine());
    level.connect();
  }
  std::vector<double> limit = level.limit_positions();
  SubdivisionMesh mesh = level.take_mesh();
  mesh.positions = std::move(limit);
  if (std::optional<std::string> problem = compute_normals(mesh)) return not_a_manifold(*problem);
  return mesh;
}

}  // namespace metrofarm::scene_file::pbrt
