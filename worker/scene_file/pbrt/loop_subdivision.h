// Loop subdivision surfaces: refined control meshes, pushed to the limit surface.
#pragma once

#include <cstdint>
#include <vector>

#include "base/result.h"

namespace metrofarm::scene_file::pbrt {

inline constexpr uint64_t kMostTriangles = uint64_t{1} << 22;

struct SubdivisionMesh {
  std::vector<double> positions;  // 3 per vertex
  std::vector<double> normals;    // 3 per vertex, unit length; empty in control meshes
  std::vector<uint32_t> indices;  // 3 per triangle; each names a vertex

  size_t vertex_count() const { return positions.size() / 3; }
};

// Refines `control` `levels` times; positions and normals are those of the limit surface. Like
// pbrt's, normals point to the side from which the control triangles run clockwise. Loop 1987;
// boundaries and masks of limit points and tangents as in Zorin and Schroeder 2000, section 3.2,
// with Warren's weights (beta = 3 / 8n). Errors (without a location): more than two triangles at an
// edge or several fans at a vertex; more than most_triangles.
Result<SubdivisionMesh> subdivide(SubdivisionMesh control, int levels,
                                  uint64_t most_triangles = kMostTriangles);

}  // namespace metrofarm::scene_file::pbrt
