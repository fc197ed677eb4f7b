#include "scene_file/mesh.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "scene_file/smooth_normals.h"

namespace metrofarm::scene_file {
namespace {

void transform_positions(const Matrix& to_world, std::vector<float>& positions) {
  if (to_world == kIdentity) return;
  for (size_t i = 0; i + 2 < positions.size(); i += 3) {
    const Point p = transform_point(to_world, {positions[i], positions[i + 1], positions[i + 2]});
    for (int axis = 0; axis < 3; ++axis) positions[i + axis] = static_cast<float>(p[axis]);
  }
}

void transform_normals(const Matrix& to_world, std::vector<float>& normals) {
  const Matrix m = normal_matrix(to_world);
  for (size_t i = 0; i + 2 < normals.size(); i += 3) {
    // Normalizing first keeps huge and tiny normals from overflowing in the product.
    const Point unit = normalized({normals[i], normals[i + 1], normals[i + 2]});
    const Point normal = normalized(transform_point(m, unit));
    for (int axis = 0; axis < 3; ++axis) normals[i + axis] = static_cast<float>(normal[axis]);
  }
}

void reverse_winding(std::vector<uint32_t>& indices) {
  for (size_t t = 0; t + 2 < indices.size(); t += 3) std::swap(indices[t + 1], indices[t + 2]);
}

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

void flip_v(std::vector<float>& texcoords) {
  for (size_t i = 1; i < texcoords.size(); i += 2) texcoords[i] = 1 - texcoords[i];
}

void finish_normals(RawMesh& raw, const MeshOptions& options) {
  const bool keeps_normals = !raw.normals.empty() && !options.max_smooth_angle &&
                             !options.face_normals && !raw.face_normals;
  if (options.mirrored_later && !keeps_normals) reverse_winding(raw.indices);
  if (options.max_smooth_angle) return smooth_up_to_angle(raw, *options.max_smooth_angle);
  if (options.face_normals || raw.face_normals) return raw.normals.clear();
  const bool mirrored = determinant(options.to_world) < 0;
  if (mirrored && !raw.normals.empty()) reverse_winding(raw.indices);
  transform_normals(options.to_world, raw.normals);
  complete_normals(raw);
}

}  // namespace

Result<scene::TriangleMesh> finish_mesh(RawMesh raw, const MeshOptions& options) {
  if (raw.indices.empty()) return Error{"the mesh has no triangles"};
  transform_positions(options.to_world, raw.positions);
  if (!all_finite(raw.positions)) {
    return Error{"a vertex position is not a finite number after the transform"};
  }
  finish_normals(raw, options);
  if (options.flip_tex_coords) flip_v(raw.texcoords);
  if (!all_finite(raw.normals)) return Error{"a vertex normal is not a finite number"};
  if (!all_finite(raw.texcoords)) return Error{"a texture coordinate is not a finite number"};
  for (const scene::MeshAttribute& attribute : raw.attributes) {
    if (all_finite(attribute.values)) continue;
    return Error{"a value of \"" + attribute.name + "\" is not a finite number"};
  }
  return scene::TriangleMesh{std::move(raw.positions), std::move(raw.normals),
                             std::move(raw.texcoords), std::move(raw.indices),
                             std::move(raw.attributes)};
}

void append_polygon(const std::vector<uint32_t>& corners, std::vector<uint32_t>& indices) {
  for (size_t i = 2; i < corners.size(); ++i) {
    indices.insert(indices.end(), {corners[0], corners[i - 1], corners[i]});
  }
}

}  // namespace metrofarm::scene_file
