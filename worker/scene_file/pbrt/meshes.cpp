#include "scene_file/pbrt/meshes.h"

#include <algorithm>
#include <cmath>

#include "scene_file/pbrt/loop_subdivision.h"
#include "scene_file/pbrt/zipped.h"
#include "scene_file/ply.h"

namespace metrofarm::scene_file::pbrt {
namespace {

std::vector<float> to_floats(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}

Point point_at(const std::vector<float>& values, size_t i) {
  return {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
}

// Groups of `corners` indices; without the parameter one group, if the vertices are just so many.
std::vector<uint32_t> read_indices(Parameters& parameters, size_t vertex_count, size_t corners,
                                   Context& context) {
  const SourceLocation& where = parameters.where();
  const bool given = parameters.find("indices") != nullptr;
  std::vector<double> numbers =
      parameters.take_numbers("indices", ParameterType::kInteger, context.problems);
  if (!given && vertex_count == corners) {
    for (size_t i = 0; i < corners; ++i) numbers.push_back(static_cast<double>(i));
  }
  if (numbers.empty() || numbers.size() % corners != 0) {
    context.problems.fail("\"indices\" must be a multiple of " + std::to_string(corners) +
                              " numbers, at least " + std::to_string(corners),
                          where);
    return {};
  }
  std::vector<uint32_t> indices;
  indices.reserve(numbers.size());
  for (double number : numbers) {
    if (!(number >= 0 && number < static_cast<double>(vertex_count))) {
      context.problems.fail("\"indices\" names vertex " +
                                std::to_string(static_cast<int64_t>(number)) + ", but \"P\" has " +
                                std::to_string(vertex_count) + " (numbered from 0)",
                            where);
      return {};
    }
    indices.push_back(static_cast<uint32_t>(number));
  }
  return indices;
}

RawMesh read_vertices(Parameters& parameters, Context& context) {
  Problems& problems = context.problems;
  RawMesh raw;
  raw.positions = to_floats(parameters.take_numbers("P", ParameterType::kPoint3, problems));
  raw.normals = to_floats(parameters.take_numbers("N", ParameterType::kNormal, problems));
  raw.texcoords = to_floats(parameters.take_numbers("uv", ParameterType::kPoint2, problems));
  const SourceLocation& where = parameters.where();
  if (raw.positions.empty()) problems.fail("the shape needs \"point3 P\", its vertices", where);
  if (!raw.normals.empty() && raw.normals.size() != raw.positions.size()) {
    problems.fail("\"N\" must have as many normals as \"P\" has points", where);
  }
  if (!raw.texcoords.empty() && raw.texcoords.size() / 2 != raw.vertex_count()) {
    problems.fail("\"uv\" must have as many pairs as \"P\" has points", where);
  }
  return raw;
}

bool is_planar(const RawMesh& raw, const uint32_t* corners) {
  const Point origin = point_at(raw.positions, corners[0]);
  Point sides[3];
  for (int i = 0; i < 3; ++i) sides[i] = subtract(point_at(raw.positions, corners[i + 1]), origin);
  const double volume = std::abs(dot(sides[2], cross(sides[0], sides[1])));
  const double size = std::max({length(sides[0]), length(sides[1]), length(sides[2])});
  constexpr double kTolerance = 1e-4;  // of the patch's size
  return volume <= kTolerance * size * size * size;
}

// Reverses triangles whose winding disagrees with the sum of their vertex normals.
void follow_normals(scene::TriangleMesh& mesh) {
  for (size_t t = 0; t < mesh.indices.size(); t += 3) {
    uint32_t* v = &mesh.indices[t];
    const Point origin = point_at(mesh.positions, v[0]);
    const Point normal = cross(subtract(point_at(mesh.positions, v[1]), origin),
                               subtract(point_at(mesh.positions, v[2]), origin));
    double agreement = 0;
    for (int i = 0; i < 3; ++i) agreement += dot(normal, point_at(mesh.normals, v[i]));
    if (agreement < 0) std::swap(v[1], v[2]);
  }
}

}  // namespace

RawMesh read_triangle_mesh(Parameters& parameters, Context& context) {
  RawMesh raw = read_vertices(parameters, context);
  raw.indices = read_indices(parameters, raw.vertex_count(), 3, context);
  parameters.ignore({"S", "faceIndices"});
  return raw;
}

RawMesh read_ply_mesh(Parameters& parameters, Context& context) {
  const std::string name = parameters.text("filename", "", context.problems);
  const SourceLocation& where = parameters.where();
  parameters.ignore({"edgelength"});
  if (parameters.find("displacement")) {
    context.problems.unsupported("displacement of plymesh is not supported", where);
  }
  const FileBytes bytes = read_named_file(name, where, context);
  if (!bytes) return {};
  Result<FileBytes> plain = unzip_if_named_gz(name, bytes, context.files.memory());
  if (!plain) {
    context.problems.fail(plain.error().message, where);
    return {};
  }
  Result<RawMesh> raw =
      parse_ply(*plain.value(), name, context.files.memory().for_file(plain.value()->size()));
  if (raw) return std::move(raw.value());
  Error error = raw.error();
  error.message += "; wanted by " + where.file + ":" + std::to_string(where.line);
  if (error.where.file.empty()) error.where.file = name;
  context.problems.fail(std::move(error));
  return {};
}

RawMesh read_bilinear_mesh(Parameters& parameters, Context& context) {
  RawMesh raw = read_vertices(parameters, context);
  const std::vector<uint32_t> patches = read_indices(parameters, raw.vertex_count(), 4, context);
  if (parameters.find("emissionfilename")) {
    context.problems.unsupported("\"emissionfilename\" is not supported", parameters.where());
  }
  parameters.ignore({"faceIndices"});
  if (context.problems.failed()) return raw;
  // Corners come as (0, 0), (1, 0), (0, 1), (1, 1) in (u, v).
  bool planar = true;
  for (size_t p = 0; p < patches.size(); p += 4) {
    const uint32_t* c = &patches[p];
    planar = planar && is_planar(raw, c);
    raw.indices.insert(raw.indices.end(), {c[0], c[1], c[3], c[0], c[3], c[2]});
  }
  if (raw.texcoords.empty() && raw.vertex_count() == 4 && patches.size() == 4) {
    raw.texcoords.resize(8);
    for (size_t i = 0; i < 4; ++i) {
      const size_t row = i / 2;
      float* uv = &raw.texcoords[2 * size_t(patches[i])];
      uv[0] = static_cast<float>(i % 2);
      uv[1] = static_cast<float>(row);
    }
  }
  if (!planar) {
    context.problems.unsupported(
        "curved bilinear patches are not supported; flat ones are read as two triangles each",
        parameters.where());
  }
  return raw;
}

RawMesh read_loop_subdivision(Parameters& parameters, Context& context) {
  SubdivisionMesh control;
  control.positions = parameters.take_numbers("P", ParameterType::kPoint3, context.problems);
  control.indices = read_indices(parameters, control.vertex_count(), 3, context);
  const int levels = parameters.integer_in("levels", 3, 0, context.problems);
  parameters.ignore({"scheme"});
  if (context.problems.failed()) return {};
  // Half a vertex with its normal, and three indices.
  constexpr uint64_t kBytesPerTriangle = 24;
  const uint64_t most = std::min(kMostTriangles, context.files.memory().left() / kBytesPerTriangle);
  const Result<SubdivisionMesh> surface = subdivide(std::move(control), levels, most);
  if (!surface) {
    context.problems.fail(surface.error().message, parameters.where());
    return {};
  }
  RawMesh raw;
  raw.positions = to_floats(surface.value().positions);
  raw.normals = to_floats(surface.value().normals);
  raw.indices = surface.value().indices;
  return raw;
}

Result<scene::TriangleMesh> place_mesh(RawMesh raw, const Matrix& to_world) {
  const bool flat = raw.normals.empty();
  Result<scene::TriangleMesh> placed =
      finish_mesh(std::move(raw), {.to_world = to_world, .face_normals = flat});
  if (!placed) return placed;
  scene::TriangleMesh& mesh = placed.value();
  if (!flat) {
    follow_normals(mesh);
  } else if (determinant(to_world) < 0) {
    for (size_t t = 0; t < mesh.indices.size(); t += 3) {
      std::swap(mesh.indices[t + 1], mesh.indices[t + 2]);
    }
  }
  return placed;
}

}  // namespace metrofarm::scene_file::pbrt
