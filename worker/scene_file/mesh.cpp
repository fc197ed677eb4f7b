#include "scene_file/mesh.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace metrofarm::scene_file {
namespace {

Point read_point(const std::vector<double>& values, size_t i) {
  return {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
}

void write_point(const Point& p, size_t i, std::vector<double>& values) {
  std::copy(p.begin(), p.end(), values.begin() + static_cast<std::ptrdiff_t>(3 * i));
}

std::vector<double> transform_positions(const RawMesh& raw, const Matrix& to_world) {
  std::vector<double> world(raw.positions.size());
  for (size_t i = 0; i < raw.vertex_count(); ++i) {
    write_point(transform_point(to_world, read_point(raw.positions, i)), i, world);
  }
  return world;
}

std::vector<double> transform_normals(const RawMesh& raw, const Matrix& to_world) {
  std::vector<double> world(raw.normals.size());
  const Matrix m = normal_matrix(to_world);
  for (size_t i = 0; i < raw.normals.size() / 3; ++i) {
    // Normalizing first keeps huge and tiny normals from overflowing in the product.
    const Point normal = normalized(read_point(raw.normals, i));
    write_point(normalized(transform_point(m, normal)), i, world);
  }
  return world;
}

double angle_between(const Point& a, const Point& b) {
  return std::atan2(length(cross(a, b)), dot(a, b));
}

// Sum over the triangles around each vertex of their unit normal times their angle there (Thuermer
// and Wuethrich 1998): it doesn't depend on how a polygon was cut into triangles.
std::vector<double> angle_weighted_normals(const std::vector<double>& positions,
                                           const std::vector<uint32_t>& indices) {
  std::vector<double> sums(positions.size(), 0.0);
  for (size_t t = 0; t + 2 < indices.size(); t += 3) {
    const Point p[3] = {read_point(positions, indices[t]), read_point(positions, indices[t + 1]),
                        read_point(positions, indices[t + 2])};
    const Point normal = normalized(cross(subtract(p[1], p[0]), subtract(p[2], p[0])));
    for (int c = 0; c < 3; ++c) {
      const double angle =
          angle_between(subtract(p[(c + 1) % 3], p[c]), subtract(p[(c + 2) % 3], p[c]));
      for (int axis = 0; axis < 3; ++axis) sums[3 * indices[t + c] + axis] += angle * normal[axis];
    }
  }
  return sums;
}

// The normals of the file where it has them, computed ones elsewhere.
std::vector<double> complete_normals(std::vector<double> from_file,
                                     const std::vector<double>& positions,
                                     const std::vector<uint32_t>& indices) {
  from_file.resize(positions.size(), 0.0);
  std::vector<double> computed;
  for (size_t i = 0; i < positions.size() / 3; ++i) {
    if (read_point(from_file, i) != Point{0, 0, 0}) continue;
    if (computed.empty()) computed = angle_weighted_normals(positions, indices);
    Point normal = normalized(read_point(computed, i));
    // A vertex that no triangle with an area uses: any unit vector will do.
    if (normal == Point{0, 0, 0}) normal = {1, 0, 0};
    write_point(normal, i, from_file);
  }
  return from_file;
}

void reverse_winding(std::vector<uint32_t>& indices) {
  for (size_t t = 0; t + 2 < indices.size(); t += 3) std::swap(indices[t + 1], indices[t + 2]);
}

std::vector<float> to_floats(const std::vector<double>& values) {
  std::vector<float> floats(values.size());
  std::transform(values.begin(), values.end(), floats.begin(),
                 [](double value) { return static_cast<float>(value); });
  return floats;
}

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

void flip_v(std::vector<float>& texcoords) {
  for (size_t i = 1; i < texcoords.size(); i += 2) texcoords[i] = 1 - texcoords[i];
}

}  // namespace

Result<scene::TriangleMesh> finish_mesh(const RawMesh& raw, const MeshOptions& options) {
  if (raw.indices.empty()) return Error{"the mesh has no triangles"};
  scene::TriangleMesh mesh;
  mesh.indices = raw.indices;
  const std::vector<double> positions = transform_positions(raw, options.to_world);
  if (!options.face_normals) {
    const bool mirrored = determinant(options.to_world) < 0;
    if (mirrored && !raw.normals.empty()) reverse_winding(mesh.indices);
    mesh.normals = to_floats(
        complete_normals(transform_normals(raw, options.to_world), positions, mesh.indices));
  }
  mesh.positions = to_floats(positions);
  mesh.texcoords = to_floats(raw.texcoords);
  if (options.flip_tex_coords) flip_v(mesh.texcoords);
  if (!all_finite(mesh.positions)) {
    return Error{"a vertex position is not a finite number after the transform"};
  }
  if (!all_finite(mesh.normals)) return Error{"a vertex normal is not a finite number"};
  if (!all_finite(mesh.texcoords)) return Error{"a texture coordinate is not a finite number"};
  return mesh;
}

void append_polygon(const std::vector<uint32_t>& corners, std::vector<uint32_t>& indices) {
  for (size_t i = 2; i < corners.size(); ++i) {
    indices.insert(indices.end(), {corners[0], corners[i - 1], corners[i]});
  }
}

}  // namespace metrofarm::scene_file
