// All primitives of a scene in flat tables: triangles of every mesh first, analytic shapes after
// them; within both, what lies outside groups comes first, then group by group. A primitive's
// number is its index in that order; Embree reports it and the tables are gathered by it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "math/vec.h"
#include "scene/description.h"

namespace metrofarm::geometry {

enum class AnalyticKind : int32_t { kSphere = 0, kDisk = 1, kCylinder = 2 };

// What belongs to a shape as a whole.
struct ShapeRecord {
  uint32_t first_primitive = 0;
  uint32_t primitive_count = 0;
};

// Values at the vertices or faces of meshes, dense over all vertices (or all triangles) of the
// scene: zero where a mesh lacks the attribute.
struct AttributeTable {
  std::string name;
  int channels = 3;
  bool per_face = false;      // else per vertex
  std::vector<float> values;  // channels per vertex or triangle, then kSpareFloats more
};

// The primitives that one acceleration structure holds: consecutive triangles and consecutive
// analytic shapes.
struct PrimitiveRange {
  int32_t first_triangle = 0;
  int32_t triangle_count = 0;
  int32_t first_analytic = 0;  // index among the analytic shapes
  int32_t analytic_count = 0;
  int32_t deforming = -1;  // number of the mesh that it is, if it deforms
  bool empty() const { return triangle_count == 0 && analytic_count == 0; }
  bool is_single_analytic() const { return triangle_count == 0 && analytic_count == 1; }
};

// A placement of a group.
struct InstanceRecord {
  int32_t group = 0;
  scene::Index instance = scene::kNone;  // of the description, or
  scene::Index shape = scene::kNone;     // the shape whose own space the group is
};

// A mesh that deforms: a group of its own.
struct DeformingMesh {
  scene::Index shape = 0;
  int32_t first_vertex = 0;  // in the tables of all meshes
  std::vector<scene::VertexKey> keys;
  std::vector<int32_t> indices;  // 3 per triangle, counted from its own first vertex
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
  std::vector<AttributeTable> attributes;  // by name
  // Their positions and normals in the tables above are those of their first key.
  std::vector<DeformingMesh> deforming;

  // ---- analytic shapes, kAnalyticStride floats each ----
  // sphere: center (3), radius, x axis (3) and z axis (3) of its surface coordinates (unit), and 1
  // or, where they are mirrored, -1;
  // disk: center (3), first half-axis (3), second half-axis (3);
  // cylinder: center of its lower end (3), radii along x (3) and y (3), axis to its upper end (3)
  std::vector<float> analytic;
  std::vector<int32_t> analytic_kind;

  // ---- by primitive ----
  std::vector<int32_t> shape_of;  // shape of each primitive

  // ---- by shape ----
  std::vector<ShapeRecord> shapes;
  std::vector<int32_t> bsdf_of;        // material
  std::vector<float> normal_sign;      // -1 where normals are flipped, else 1
  std::vector<int32_t> has_normals;    // 1 where the mesh has vertex normals
  std::vector<int32_t> has_texcoords;  // 1 where the mesh has texture coordinates

  // ---- groups and instances ----
  PrimitiveRange world;  // what lies outside groups
  // The description's groups, then one for each shape outside groups that moves or deforms.
  std::vector<PrimitiveRange> groups;
  std::vector<InstanceRecord> instances;   // the description's, then those of shapes that move
  std::vector<int32_t> instance_of_shape;  // of a shape that moves; else kNone

  uint64_t bytes() const;
};

// No limit.
inline constexpr uint64_t kAnyBytes = ~uint64_t{0};

inline constexpr int kAnalyticStride = 12;
// Rounding error of a position is proportional to the coordinates it was computed from; this many
// times float's epsilon covers barycentric interpolation and the next intersection test.
inline constexpr float kOffsetScale = 128 * 0x1p-23F;
// Enough for a masked load from an empty table too.
inline constexpr int kSpareFloats = 4;

// Concatenates the shapes of a scene. Mesh data is moved out of the description; attributes that no
// texture names are dropped.
Primitives build_primitives(scene::SceneDescription& description);

// Area of one primitive in the space of its group; of a cylinder its lateral surface.
double area_of(const Primitives& primitives, uint32_t primitive);
// Of a triangle of the mesh, at the key where it is largest.
double largest_area_of(const DeformingMesh& mesh, size_t triangle);

struct Bounds {
  float lower[3];
  float upper[3];
};
// In the group's space; lower > upper if there is nothing.
Bounds bounds_of(const Primitives& primitives, const PrimitiveRange& range);
// Around nothing.
Bounds no_bounds();
void include(Bounds& bounds, int axis, float low, float high);
void include(Bounds& bounds, const Bounds& box);
// How far the farthest corner is from the origin.
double reach_of(const Bounds& box);
// The box around a box under an affine map, 3 x 4, row major (Arvo 1990, "Transforming Axis-Aligned
// Bounding Boxes").
void include_mapped(Bounds& bounds, const Bounds& box, const float* map);

}  // namespace metrofarm::geometry
