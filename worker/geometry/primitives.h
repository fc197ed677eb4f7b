// All primitives of a scene in flat tables: triangles of every mesh first, analytic shapes after
// them. A primitive's number is its index in that order; Embree reports it and the tables are
// gathered by it.
#pragma once

#include <cstdint>
#include <vector>

#include "math/vec.h"
#include "scene/description.h"

namespace metrofarm::geometry {

enum class AnalyticKind : int32_t { kSphere = 0, kDisk = 1 };

// What belongs to a shape as a whole.
struct ShapeRecord {
  uint32_t first_primitive = 0;
  uint32_t primitive_count = 0;
};

struct Primitives {
  // ---- triangles ----
  // Vertex tables end with kSpareFloats more, for loads that are four floats wide.
  std::vector<float> positions;  // 3 per vertex
  std::vector<float> normals;    // 3 per vertex; zero where the mesh has none; empty if none has
  std::vector<float> texcoords;  // 2 per vertex; zero where the mesh has none; empty if none has
  std::vector<int32_t> indices;  // 3 per triangle
  int32_t triangle_count = 0;
  size_t vertex_count = 0;

  // ---- analytic shapes, 10 floats each ----
  // sphere: center (3), radius; disk: center (3), first half-axis (3), second half-axis (3)
  std::vector<float> analytic;
  std::vector<int32_t> analytic_kind;

  // ---- by primitive ----
  std::vector<int32_t> shape_of;  // shape of each primitive

  // ---- by shape ----
  std::vector<ShapeRecord> shapes;
  std::vector<int32_t> bsdf_of;      // material
  std::vector<float> normal_sign;    // -1 where normals are flipped, else 1
  std::vector<int32_t> has_normals;  // 1 where the mesh has vertex normals

  uint64_t bytes() const;
};

inline constexpr int kAnalyticStride = 10;
// Enough for a masked load from an empty table too.
inline constexpr int kSpareFloats = 4;

// Concatenates the shapes of a scene. Mesh data is moved out of the description.
Primitives build_primitives(scene::SceneDescription& description);

// World-space area of one primitive.
double area_of(const Primitives& primitives, uint32_t primitive);

}  // namespace metrofarm::geometry
