#include "geometry/primitives.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/check.h"
#include "scene/linear.h"

namespace metrofarm::geometry {
namespace {

using scene::Cylinder;
using scene::Disk;
using scene::Matrix;
using scene::SceneDescription;
using scene::Shape;
using scene::Sphere;
using scene::TriangleMesh;

template <class T>
uint64_t bytes_of(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

// What all meshes together need, so that no table grows twice.
struct Totals {
  size_t vertices = 0;
  size_t triangles = 0;
  bool normals = false;
  bool texcoords = false;
};

Totals totals_of(const SceneDescription& description) {
  Totals t;
  for (const Shape& shape : description.shapes) {
    const auto* mesh = std::get_if<TriangleMesh>(&shape.geometry);
    if (mesh == nullptr) continue;
    t.vertices += mesh->positions.size() / 3;
    t.triangles += mesh->indices.size() / 3;
    t.normals = t.normals || !mesh->normals.empty();
    t.texcoords = t.texcoords || !mesh->texcoords.empty();
  }
  return t;
}

bool is_looked_up(const SceneDescription& description, const std::string& attribute) {
  return std::any_of(description.textures.begin(), description.textures.end(),
                     [&](const scene::Texture& texture) {
                       const auto* model = std::get_if<scene::AttributeTexture>(&texture.model);
                       return model != nullptr && model->name == attribute;
                     });
}

class Builder {
 public:
  explicit Builder(SceneDescription& description)
      : description_(description), totals_(totals_of(description)) {}

  Primitives build() {
    sort_by_group();
    out_.shapes.resize(description_.shapes.size());
    for (const Shape& shape : description_.shapes) add_shape_record(shape);
    reserve();
    for (size_t s : order_) {
      if (auto* mesh = std::get_if<TriangleMesh>(&description_.shapes[s].geometry)) {
        add_mesh(static_cast<int32_t>(s), *mesh);
        if (!mesh->keys.empty()) add_deforming(static_cast<int32_t>(s), *mesh);
        *mesh = {};
      }
    }
    out_.triangle_count = static_cast<int32_t>(out_.indices.size() / 3);
    out_.vertex_count = totals_.vertices;
    for (size_t s : order_) add_analytic(static_cast<int32_t>(s));
    start_ranges();
    out_.positions.resize(out_.positions.size() + kSpareFloats, 0.F);
    if (totals_.normals) out_.normals.resize(out_.normals.size() + kSpareFloats, 0.F);
    if (totals_.texcoords) out_.texcoords.resize(out_.texcoords.size() + kSpareFloats, 0.F);
    return std::move(out_);
  }

 private:
  // Shapes outside groups, then those of each group; scenes without groups keep their order.
  void sort_by_group() {
    place_instances();
    order_.resize(description_.shapes.size());
    std::iota(order_.begin(), order_.end(), 0);
    std::stable_sort(order_.begin(), order_.end(),
                     [&](size_t a, size_t b) { return group_of_[a] < group_of_[b]; });
  }

  // What moves by itself is a group of its own, with one instance.
  void place_instances() {
    scene::Index groups = 0;
    for (const Shape& shape : description_.shapes) {
      group_of_.push_back(shape.group);
      groups = std::max(groups, shape.group + 1);
    }
    for (size_t i = 0; i < description_.instances.size(); ++i) {
      const scene::Index group = description_.instances[i].group;
      out_.instances.push_back({group, static_cast<scene::Index>(i), scene::kNone});
      groups = std::max(groups, group + 1);
    }
    out_.instance_of_shape.assign(description_.shapes.size(), scene::kNone);
    for (size_t s = 0; s < description_.shapes.size(); ++s) {
      if (!moves(description_.shapes[s])) continue;
      group_of_[s] = groups++;
      out_.instance_of_shape[s] = static_cast<int32_t>(out_.instances.size());
      out_.instances.push_back({group_of_[s], scene::kNone, static_cast<scene::Index>(s)});
    }
    out_.groups.resize(static_cast<size_t>(groups));
  }

  static bool moves(const Shape& shape) {
    return shape.group == scene::kNone && (!shape.motion.empty() || !shape.key_times.empty());
  }

  PrimitiveRange& range_of(int32_t shape) {
    const scene::Index group = group_of_[shape];
    return group == scene::kNone ? out_.world : out_.groups[static_cast<size_t>(group)];
  }

  // Sets each range's start from the counts before it.
  void start_ranges() {
    PrimitiveRange end;
    const auto start = [&](PrimitiveRange& range) {
      range.first_triangle = end.triangle_count;
      range.first_analytic = end.analytic_count;
      end.triangle_count += range.triangle_count;
      end.analytic_count += range.analytic_count;
    };
    start(out_.world);
    for (PrimitiveRange& group : out_.groups) start(group);
  }

  void reserve() {
    out_.positions.reserve(3 * totals_.vertices + kSpareFloats);
    out_.indices.reserve(3 * totals_.triangles);
    out_.shape_of.reserve(totals_.triangles + description_.shapes.size());
    if (totals_.normals) out_.normals.reserve(3 * totals_.vertices + kSpareFloats);
    if (totals_.texcoords) out_.texcoords.reserve(2 * totals_.vertices + kSpareFloats);
  }

  void add_shape_record(const Shape& shape) {
    const auto* mesh = std::get_if<TriangleMesh>(&shape.geometry);
    const auto* disk = std::get_if<Disk>(&shape.geometry);
    out_.bsdf_of.push_back(shape.bsdf);
    // A disk's normal stays on the side of its +z, also where a mirror turns its half-axes about.
    const bool mirrored =
        disk != nullptr && scene::determinant(scene::linear_part(disk->to_world)) < 0;
    out_.normal_sign.push_back(shape.flip_normals != mirrored ? -1.F : 1.F);
    out_.has_normals.push_back(mesh != nullptr && !mesh->normals.empty() ? 1 : 0);
    out_.has_texcoords.push_back(mesh != nullptr && !mesh->texcoords.empty() ? 1 : 0);
  }

  void add_mesh(int32_t shape, const TriangleMesh& mesh) {
    const auto first_vertex = static_cast<int32_t>(out_.positions.size() / 3);
    const size_t triangles = mesh.indices.size() / 3;
    out_.shapes[shape] = {static_cast<uint32_t>(out_.shape_of.size()),
                          static_cast<uint32_t>(triangles)};
    range_of(shape).triangle_count += static_cast<int32_t>(triangles);
    for (const scene::MeshAttribute& attribute : mesh.attributes) add_attribute(attribute);
    out_.positions.insert(out_.positions.end(), mesh.positions.begin(), mesh.positions.end());
    append_or_zero(totals_.normals, mesh.normals, out_.normals, out_.positions.size());
    append_or_zero(totals_.texcoords, mesh.texcoords, out_.texcoords,
                   out_.positions.size() / 3 * 2);
    for (uint32_t index : mesh.indices)
      out_.indices.push_back(first_vertex + static_cast<int32_t>(index));
    out_.shape_of.insert(out_.shape_of.end(), triangles, shape);
  }

  // Requires: the mesh has just been added.
  void add_deforming(int32_t shape, TriangleMesh& mesh) {
    METROFARM_CHECK(group_of_[shape] != scene::kNone);
    DeformingMesh added;
    added.shape = shape;
    added.first_vertex = static_cast<int32_t>((out_.positions.size() - mesh.positions.size()) / 3);
    added.keys = std::move(mesh.keys);
    added.indices.assign(mesh.indices.begin(), mesh.indices.end());
    range_of(shape).deforming = static_cast<int32_t>(out_.deforming.size());
    out_.deforming.push_back(std::move(added));
  }

  static void append_or_zero(bool wanted, const std::vector<float>& source,
                             std::vector<float>& table, size_t new_size) {
    if (!wanted) return;
    table.insert(table.end(), source.begin(), source.end());
    table.resize(new_size, 0.F);
  }

  // Requires: the tables still end where the mesh will begin.
  void add_attribute(const scene::MeshAttribute& attribute) {
    if (!is_looked_up(description_, attribute.name)) return;
    AttributeTable& table = table_of(attribute);
    const size_t first = attribute.per_face ? out_.indices.size() / 3 : out_.positions.size() / 3;
    const auto from = static_cast<size_t>(attribute.channels);
    const auto to = static_cast<size_t>(table.channels);
    for (size_t i = 0; i < attribute.values.size() / from; ++i) {
      for (size_t c = 0; c < to; ++c)
        table.values[(first + i) * to + c] = attribute.values[i * from + std::min(c, from - 1)];
    }
  }

  AttributeTable& table_of(const scene::MeshAttribute& attribute) {
    for (AttributeTable& table : out_.attributes) {
      if (table.name != attribute.name || table.per_face != attribute.per_face) continue;
      if (table.channels < attribute.channels) widen(table);
      return table;
    }
    const size_t rows = attribute.per_face ? totals_.triangles : totals_.vertices;
    out_.attributes.push_back({attribute.name, attribute.channels, attribute.per_face, {}});
    out_.attributes.back().values.resize(rows * size_t(attribute.channels) + kSpareFloats, 0.F);
    return out_.attributes.back();
  }

  // From one channel to three that are equal: meshes may disagree on what a name holds.
  static void widen(AttributeTable& table) {
    std::vector<float> grey = std::move(table.values);
    const size_t rows = grey.size() - kSpareFloats;
    table.channels = 3;
    table.values.assign(3 * rows + kSpareFloats, 0.F);
    for (size_t i = 0; i < 3 * rows; ++i) table.values[i] = grey[i / 3];
  }

  void add_analytic(int32_t shape) {
    const auto& geometry = description_.shapes[shape].geometry;
    if (std::holds_alternative<TriangleMesh>(geometry)) return;
    out_.shapes[shape] = {static_cast<uint32_t>(out_.shape_of.size()), 1};
    out_.shape_of.push_back(shape);
    ++range_of(shape).analytic_count;
    if (const auto* sphere = std::get_if<Sphere>(&geometry)) {
      const auto& r = sphere->rotation;
      const auto& c = sphere->center;
      add(AnalyticKind::kSphere, {c[0], c[1], c[2], sphere->radius, r[0], r[3], r[6], r[2], r[5],
                                  r[8], scene::determinant(r) < 0 ? -1.0 : 1.0});
    } else if (const auto* disk = std::get_if<Disk>(&geometry)) {
      const auto& m = disk->to_world;
      add(AnalyticKind::kDisk, {m[3], m[7], m[11], m[0], m[4], m[8], m[1], m[5], m[9]});
    } else {
      const auto& m = std::get<Cylinder>(geometry).to_world;
      add(AnalyticKind::kCylinder,
          {m[3], m[7], m[11], m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]});
    }
  }

  void add(AnalyticKind kind, std::initializer_list<double> values) {
    METROFARM_CHECK(values.size() <= kAnalyticStride);
    const size_t end = out_.analytic.size() + kAnalyticStride;
    for (double v : values) out_.analytic.push_back(static_cast<float>(v));
    out_.analytic.resize(end, 0.F);
    out_.analytic_kind.push_back(static_cast<int32_t>(kind));
  }

  SceneDescription& description_;
  Totals totals_;
  Primitives out_;
  std::vector<scene::Index> group_of_;  // by shape
  std::vector<size_t> order_;           // shapes by group
};

}  // namespace

uint64_t Primitives::bytes() const {
  uint64_t sum = 0;
  for (const AttributeTable& table : attributes) sum += bytes_of(table.values);
  for (const DeformingMesh& mesh : deforming) {
    sum += bytes_of(mesh.indices);
    for (const scene::VertexKey& key : mesh.keys)
      sum += bytes_of(key.positions) + bytes_of(key.normals);
  }
  return sum + bytes_of(positions) + bytes_of(normals) + bytes_of(texcoords) + bytes_of(indices) +
         bytes_of(analytic) + bytes_of(analytic_kind) + bytes_of(shape_of) + bytes_of(shapes) +
         bytes_of(bsdf_of) + bytes_of(normal_sign) + bytes_of(has_normals) +
         bytes_of(has_texcoords) + bytes_of(groups) + bytes_of(instances) +
         bytes_of(instance_of_shape);
}

Primitives build_primitives(SceneDescription& description) {
  return Builder(description).build();
}

}  // namespace metrofarm::geometry
