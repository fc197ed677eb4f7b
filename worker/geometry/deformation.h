// Meshes whose vertices move while a shutter is open.
//
// Each is kept as positions, and normals if it has any, at equal distances in time from the
// interval's begin to its end, linear in between: as Embree takes them.
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/primitives.h"
#include "motion/track.h"

namespace metrofarm::geometry {

// The corners of triangles at one time, and their vertex normals where they were asked for.
struct DeformedCorners {
  Vec3 position[3];
  Vec3 normal[3];
};

// Immutable; thread-safe. Times of lanes are in [0, 1], from the interval's begin to its end.
class Deformations {
 public:
  // key_times: of each shape, see scene::Shape.
  // Throws std::bad_alloc, before there are tables, if they would take more than max_bytes or have
  // more rows than 32-bit numbers of floats reach.
  Deformations(const std::vector<scene::Shape>& shapes, const Primitives& primitives,
               const motion::Interval& interval, uint64_t max_bytes = kAnyBytes);

  bool empty() const { return first_row_.empty(); }
  bool anything_moves() const { return anything_moves_; }

  // Lanes whose shape is such a mesh.
  Mask deforming(Int shape, Mask lanes) const;
  // Requires: the lanes are deforming. corner: numbers of vertices in the tables of all meshes.
  DeformedCorners at(Int shape, const Int corner[3], Float time, bool normals, Mask lanes) const;

  // ---- of one mesh, by its number among Primitives::deforming ----
  int step_count(size_t mesh) const { return step_count_[mesh]; }
  // Of a step's first vertex: three floats for each, and more after the last.
  const float* positions(size_t mesh, int step) const {
    return &positions_[3 * (static_cast<size_t>(first_of_mesh_[mesh]) +
                            static_cast<size_t>(step) * vertex_count_[mesh])];
  }

  uint64_t bytes() const;

 private:
  void reserve(const std::vector<DeformingMesh>& meshes, const std::vector<int>& segments,
               uint64_t max_bytes);
  void add(const DeformingMesh& mesh, const std::vector<double>& times,
           const motion::Interval& interval, int segments);

  // 3 per row; a row per mesh, step and vertex.
  std::vector<float> positions_;
  std::vector<float> normals_;  // zero where the mesh has none; empty if none has
  bool anything_moves_ = false;
  // By mesh.
  std::vector<int32_t> first_of_mesh_, step_count_;
  std::vector<size_t> vertex_count_;
  // By shape; empty if there is no such mesh.
  std::vector<int32_t> first_row_;     // -1 of others
  std::vector<int32_t> segments_;      // steps less one
  std::vector<int32_t> rows_;          // of one step
  std::vector<int32_t> first_vertex_;  // in the tables of all meshes
};

}  // namespace metrofarm::geometry
