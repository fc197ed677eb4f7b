// The common last step of all mesh formats: from what a file holds to a mesh in world space.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "scene/description.h"
#include "scene_file/affine.h"

namespace metrofarm::scene_file {

// A mesh in its own space, as a file holds it. Readers guarantee that normals, texcoords and
// attributes are empty or as many as the vertices (faces), and that every index names a vertex.
struct RawMesh {
  std::vector<float> positions;   // 3 per vertex
  std::vector<float> normals;     // 3 per vertex, any length; (0, 0, 0) where the file has none
  std::vector<float> texcoords;   // 2 per vertex
  std::vector<uint32_t> indices;  // 3 per triangle
  std::vector<scene::MeshAttribute> attributes = {};
  bool face_normals = false;  // the file asks for flat shading

  size_t vertex_count() const { return positions.size() / 3; }
};

struct MeshOptions {
  Matrix to_world = kIdentity;
  bool mirrored_later = false;   // it moves, and its poses mirror it
  bool face_normals = false;     // drop vertex normals
  bool flip_tex_coords = false;  // v becomes 1 - v
  // Where given, normals are computed anew, smooth over edges of at most this angle (degrees).
  std::optional<double> max_smooth_angle = {};
};

// Transforms the mesh to world space, in place. Unless face_normals is set, vertices without a
// normal get the angle-weighted mean of the triangles around them. Under a mirroring transform the
// normals of the file keep pointing outwards and the winding is reversed to agree with them; a mesh
// without normals keeps its winding, so its inside and outside change places (as in Mitsuba), also
// where the mirror comes later.
// Errors (without a location): no triangles, numbers that are not finite or too large for float.
Result<scene::TriangleMesh> finish_mesh(RawMesh raw, const MeshOptions& options);

// Appends a polygon as a fan of triangles around its first corner. Requires: at least 3 corners.
void append_polygon(const std::vector<uint32_t>& corners, std::vector<uint32_t>& indices);

}  // namespace metrofarm::scene_file
