#include "geometry/primitives.h"

#include <cmath>
#include <numbers>

#include "base/check.h"

namespace metrofarm::geometry {
namespace {

using scene::Disk;
using scene::SceneDescription;
using scene::Shape;
using scene::Sphere;
using scene::TriangleMesh;

template <class T>
uint64_t bytes_of(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

bool any_mesh(const SceneDescription& description, bool (*wants)(const TriangleMesh&)) {
  for (const Shape& shape : description.shapes) {
    const auto* mesh = std::get_if<TriangleMesh>(&shape.geometry);
    if (mesh != nullptr && wants(*mesh)) return true;
  }
  return false;
}

class Builder {
 public:
  explicit Builder(SceneDescription& description) : description_(description) {
    wants_normals_ =
        any_mesh(description, [](const TriangleMesh& m) { return !m.normals.empty(); });
    wants_texcoords_ =
        any_mesh(description, [](const TriangleMesh& m) { return !m.texcoords.empty(); });
  }

  Primitives build() {
    const size_t count = description_.shapes.size();
    out_.shapes.resize(count);
    for (size_t s = 0; s < count; ++s) add_shape_record(description_.shapes[s]);
    for (size_t s = 0; s < count; ++s) {
      if (auto* mesh = std::get_if<TriangleMesh>(&description_.shapes[s].geometry)) {
        add_mesh(static_cast<int32_t>(s), *mesh);
        *mesh = {};
      }
    }
    out_.triangle_count = static_cast<int32_t>(out_.indices.size() / 3);
    for (size_t s = 0; s < count; ++s) add_analytic(static_cast<int32_t>(s));
    out_.vertex_count = out_.positions.size() / 3;
    out_.positions.resize(out_.positions.size() + kSpareFloats, 0.F);
    if (wants_normals_) out_.normals.resize(out_.normals.size() + kSpareFloats, 0.F);
    return std::move(out_);
  }

 private:
  void add_shape_record(const Shape& shape) {
    const auto* mesh = std::get_if<TriangleMesh>(&shape.geometry);
    out_.bsdf_of.push_back(shape.bsdf);
    out_.normal_sign.push_back(shape.flip_normals ? -1.F : 1.F);
    out_.has_normals.push_back(mesh != nullptr && !mesh->normals.empty() ? 1 : 0);
  }

  void add_mesh(int32_t shape, const TriangleMesh& mesh) {
    const auto first_vertex = static_cast<int32_t>(out_.positions.size() / 3);
    const size_t triangles = mesh.indices.size() / 3;
    out_.shapes[shape] = {static_cast<uint32_t>(out_.shape_of.size()),
                          static_cast<uint32_t>(triangles)};
    out_.positions.insert(out_.positions.end(), mesh.positions.begin(), mesh.positions.end());
    append_or_zero(wants_normals_, mesh.normals, out_.normals, out_.positions.size());
    append_or_zero(wants_texcoords_, mesh.texcoords, out_.texcoords, out_.positions.size() / 3 * 2);
    for (uint32_t index : mesh.indices)
      out_.indices.push_back(first_vertex + static_cast<int32_t>(index));
    out_.shape_of.insert(out_.shape_of.end(), triangles, shape);
  }

  static void append_or_zero(bool wanted, const std::vector<float>& source,
                             std::vector<float>& table, size_t new_size) {
    if (!wanted) return;
    table.insert(table.end(), source.begin(), source.end());
    table.resize(new_size, 0.F);
  }

  void add_analytic(int32_t shape) {
    const auto& geometry = description_.shapes[shape].geometry;
    if (std::holds_alternative<TriangleMesh>(geometry)) return;
    out_.shapes[shape] = {static_cast<uint32_t>(out_.shape_of.size()), 1};
    out_.shape_of.push_back(shape);
    if (const auto* sphere = std::get_if<Sphere>(&geometry)) {
      add_floats({sphere->center[0], sphere->center[1], sphere->center[2], sphere->radius});
      out_.analytic_kind.push_back(static_cast<int32_t>(AnalyticKind::kSphere));
    } else {
      const auto& m = std::get<Disk>(geometry).to_world;
      add_floats({m[3], m[7], m[11], m[0], m[4], m[8], m[1], m[5], m[9]});
      out_.analytic_kind.push_back(static_cast<int32_t>(AnalyticKind::kDisk));
    }
  }

  void add_floats(std::initializer_list<double> values) {
    METROFARM_CHECK(values.size() <= kAnalyticStride);
    const size_t end = out_.analytic.size() + kAnalyticStride;
    for (double v : values) out_.analytic.push_back(static_cast<float>(v));
    out_.analytic.resize(end, 0.F);
  }

  SceneDescription& description_;
  Primitives out_;
  bool wants_normals_ = false;
  bool wants_texcoords_ = false;
};

struct Double3 {
  double x, y, z;
};

double cross_length(Double3 a, Double3 b) {
  return std::hypot(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

double triangle_area(const Primitives& p, uint32_t triangle) {
  const int32_t* i = &p.indices[3 * size_t{triangle}];
  const float* a = &p.positions[3 * size_t(i[0])];
  const float* b = &p.positions[3 * size_t(i[1])];
  const float* c = &p.positions[3 * size_t(i[2])];
  return 0.5 * cross_length({double(b[0]) - a[0], double(b[1]) - a[1], double(b[2]) - a[2]},
                            {double(c[0]) - a[0], double(c[1]) - a[1], double(c[2]) - a[2]});
}

}  // namespace

uint64_t Primitives::bytes() const {
  return bytes_of(positions) + bytes_of(normals) + bytes_of(texcoords) + bytes_of(indices) +
         bytes_of(analytic) + bytes_of(analytic_kind) + bytes_of(shape_of) + bytes_of(shapes) +
         bytes_of(bsdf_of) + bytes_of(normal_sign) + bytes_of(has_normals);
}

Primitives build_primitives(SceneDescription& description) {
  return Builder(description).build();
}

double area_of(const Primitives& p, uint32_t primitive) {
  if (primitive < static_cast<uint32_t>(p.triangle_count)) return triangle_area(p, primitive);
  const uint32_t i = primitive - static_cast<uint32_t>(p.triangle_count);
  const float* a = &p.analytic[size_t{i} * kAnalyticStride];
  if (p.analytic_kind[i] == static_cast<int32_t>(AnalyticKind::kSphere))
    return 4 * std::numbers::pi * double(a[3]) * a[3];
  return std::numbers::pi * cross_length({a[3], a[4], a[5]}, {a[6], a[7], a[8]});
}

}  // namespace metrofarm::geometry
