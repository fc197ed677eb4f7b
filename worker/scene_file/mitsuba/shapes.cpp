#include "scene_file/mitsuba/shapes.h"

#include <cmath>
#include <limits>

#include "scene_file/mesh.h"
#include "scene_file/mitsuba/bsdfs.h"
#include "scene_file/mitsuba/emitters.h"
#include "scene_file/obj.h"
#include "scene_file/ply.h"
#include "scene_file/serialized.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Shape;

void finish_into(const RawMesh& raw, const MeshOptions& options, const SourceLocation& where,
                 Shape& shape, Context& context) {
  Result<scene::TriangleMesh> mesh = finish_mesh(raw, options);
  if (!mesh) return context.problems.fail(mesh.error().message, where);
  shape.geometry = std::move(mesh.value());
}

void load_rectangle(Properties& properties, Shape& shape, Context& context) {
  RawMesh raw;
  raw.positions = {-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0};
  raw.normals = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
  raw.texcoords = {0, 0, 1, 0, 0, 1, 1, 1};
  raw.indices = {0, 1, 2, 2, 1, 3};
  properties.ignore({"face_normals"});
  finish_into(raw, {.to_world = properties.transform("to_world")}, shape.where, shape, context);
}

// Each face is given by its normal and the direction in which u grows; the numbering of vertices,
// triangles and texture coordinates is Mitsuba's.
void load_cube(Properties& properties, Shape& shape, Context& context) {
  struct Face {
    Point normal;
    Point u;
  };
  constexpr Face kFaces[] = {
      {{0, -1, 0}, {0, 0, 1}}, {{0, 1, 0}, {-1, 0, 0}}, {{1, 0, 0}, {0, 1, 0}},
      {{0, 0, 1}, {0, 1, 0}},  {{-1, 0, 0}, {0, 1, 0}}, {{0, 0, -1}, {0, -1, 0}},
  };
  constexpr double kCorners[4][2] = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  RawMesh raw;
  for (const Face& face : kFaces) {
    const auto first = static_cast<uint32_t>(raw.vertex_count());
    const Point v = cross(face.normal, face.u);
    for (const auto& [s, t] : kCorners) {
      for (int axis = 0; axis < 3; ++axis) {
        raw.positions.push_back(face.normal[axis] + (2 * s - 1) * face.u[axis] -
                                (2 * t - 1) * v[axis]);
      }
      raw.normals.insert(raw.normals.end(), face.normal.begin(), face.normal.end());
      raw.texcoords.insert(raw.texcoords.end(), {s, t});
    }
    for (uint32_t corner : {0U, 1U, 2U, 3U, 0U, 2U}) raw.indices.push_back(first + corner);
  }
  properties.ignore({"face_normals"});
  finish_into(raw, {.to_world = properties.transform("to_world")}, shape.where, shape, context);
}

void load_sphere(Properties& properties, Shape& shape, Context& context) {
  scene::Sphere sphere;
  const Matrix to_world = properties.transform("to_world");
  sphere.center = transform_point(to_world, properties.point("center", {0, 0, 0}));
  const double radius = properties.number("radius", 1);
  const double scale = length(column(to_world, 0));
  constexpr double kTolerance = 1e-4;
  if (!(radius > 0)) {
    context.problems.fail("the radius of a sphere must be greater than 0",
                          properties.find("radius")->where);
  } else if (!(scale > 0) ||
             deviation_from_rotation(to_world, scale) > kTolerance * scale * scale) {
    context.problems.fail(
        "a sphere's to_world must scale equally in all directions; for an "
        "ellipsoid use a mesh",
        properties.find("to_world")->where);
  }
  sphere.radius = radius * scale;
  // A mirrored sphere is seen from inside.
  if (determinant(to_world) < 0) shape.flip_normals = !shape.flip_normals;
  shape.geometry = sphere;
}

void load_disk(Properties& properties, Shape& shape, Context& context) {
  scene::Disk disk;
  disk.to_world = properties.transform("to_world");
  const Point normal = normalized(cross(column(disk.to_world, 0), column(disk.to_world, 1)));
  if (length(normal) == 0) {
    return context.problems.fail("a disk's to_world must not flatten it to a line",
                                 properties.find("to_world")->where);
  }
  // Only the first two axes shape a disk: with a flat third one the matrix would have no inverse.
  if (determinant(disk.to_world) == 0) {
    for (int axis = 0; axis < 3; ++axis) disk.to_world[4 * axis + 2] = normal[axis];
  }
  shape.geometry = disk;
}

using MeshReader = Result<RawMesh> (*)(std::string_view bytes, const std::string& file_name,
                                       Properties& properties);

// The part that all shapes from files share. An error inside the file is located there; the message
// then says which shape wanted it.
void load_file(Properties& properties, Shape& shape, Context& context, MeshReader reader,
               MeshOptions options) {
  const std::string name = properties.text("filename", "");
  if (name.empty()) {
    return context.problems.fail(properties.element().describe() + " needs a \"filename\"",
                                 shape.where);
  }
  const SourceLocation& where = properties.find("filename")->where;
  options.to_world = properties.transform("to_world");
  options.face_normals = properties.boolean("face_normals", false);
  const Result<std::filesystem::path> path = context.files.find(name);
  if (!path) return context.problems.fail(path.error().message, where);
  const Result<FileBytes> bytes = context.files.read(path.value());
  if (!bytes) return context.problems.fail(bytes.error().message, where);
  const std::string file_name = path.value().string();
  const Result<RawMesh> raw = reader(*bytes.value(), file_name, properties);
  const std::string wanted_by =
      " (read for the shape at " + where.file + ":" + std::to_string(where.line) + ")";
  if (!raw) {
    Error error = raw.error();
    if (error.where.file.empty()) error.where.file = file_name;
    error.message += wanted_by;
    return context.problems.fail(std::move(error));
  }
  Result<scene::TriangleMesh> mesh = finish_mesh(raw.value(), options);
  if (!mesh) return context.problems.fail(mesh.error().message + wanted_by, {file_name});
  shape.geometry = std::move(mesh.value());
}

void load_obj(Properties& properties, Shape& shape, Context& context) {
  const auto reader = [](std::string_view bytes, const std::string& name, Properties&) {
    return parse_obj(bytes, name);
  };
  load_file(properties, shape, context, reader,
            {.flip_tex_coords = properties.boolean("flip_tex_coords", true)});
}

void load_ply(Properties& properties, Shape& shape, Context& context) {
  const auto reader = [](std::string_view bytes, const std::string& name, Properties&) {
    return parse_ply(bytes, name);
  };
  load_file(properties, shape, context, reader,
            {.flip_tex_coords = properties.boolean("flip_tex_coords", false)});
}

void load_serialized(Properties& properties, Shape& shape, Context& context) {
  const auto reader = [](std::string_view bytes, const std::string&, Properties& own) {
    return parse_serialized(bytes, own.integer("shape_index", 0));
  };
  load_file(properties, shape, context, reader, {});
}

constexpr Plugin<void (*)(Properties&, Shape&, Context&)> kShapes[] = {
    {"rectangle", load_rectangle},
    {"cube", load_cube},
    {"sphere", load_sphere},
    {"disk", load_disk},
    {"obj", load_obj},
    {"ply", load_ply},
    {"serialized", load_serialized},
};

}  // namespace

void load_shape(const Element& element, Context& context) {
  const auto* plugin = find_plugin(kShapes, element, "it is left out", context.problems);
  if (!plugin) return;
  Properties properties = context.properties_of(element);
  Shape shape;
  shape.id = element.get("id");
  shape.where = element.where;
  shape.flip_normals = properties.boolean("flip_normals", false);
  plugin->load(properties, shape, context);
  if (const Element* emitter = properties.object("emitter")) {
    shape.area_emitter = load_area_emitter(*emitter, context);
  }
  const Element* bsdf = properties.object("bsdf");
  const bool is_light = shape.area_emitter != scene::kNone;
  shape.bsdf = bsdf ? load_bsdf(*bsdf, context) : default_bsdf(is_light, context);
  properties.ignore({"silhouette_sampling_weight"});
  properties.finish();
  context.scene.shapes.push_back(std::move(shape));
}

}  // namespace metrofarm::scene_file::mitsuba
