#include "scene_file/mitsuba/mesh_shapes.h"

#include <utility>

namespace metrofarm::scene_file::mitsuba {
namespace {

// The part that all shapes from files share.
void queue_file(Properties& properties, const scene::Shape& shape, Context& context,
                MeshRequest request) {
  const std::string name = properties.text("filename", "");
  if (name.empty()) {
    return context.problems.fail(properties.element().describe() + " needs a \"filename\"",
                                 shape.where);
  }
  request.where = properties.find("filename")->where;
  request.options.to_world = properties.transform("to_world");
  request.options.face_normals = properties.boolean("face_normals", false);
  // Mitsuba 0.6 only.
  if (properties.has("max_smooth_angle")) {
    request.options.max_smooth_angle = properties.number_in("max_smooth_angle", 0, 0, 180);
  }
  const Result<std::filesystem::path> path = context.files.find(name);
  if (!path) return context.problems.fail(path.error().message, request.where);
  request.file = path.value();
  request.shape = context.scene.shapes.size();
  request.name = properties.element().describe() + (shape.id.empty() ? "" : " " + shape.id);
  context.meshes.add(std::move(request), context.files);
}

}  // namespace

void load_obj(Properties& properties, scene::Shape& shape, Context& context) {
  MeshRequest request;
  request.format = MeshFormat::kObj;
  request.options.flip_tex_coords = properties.boolean("flip_tex_coords", true);
  properties.ignore({"collapse", "load_materials"});
  queue_file(properties, shape, context, std::move(request));
}

void load_ply(Properties& properties, scene::Shape& shape, Context& context) {
  MeshRequest request;
  request.format = MeshFormat::kPly;
  request.options.flip_tex_coords = properties.boolean("flip_tex_coords", false);
  properties.ignore({"srgb"});
  queue_file(properties, shape, context, std::move(request));
}

void load_serialized(Properties& properties, scene::Shape& shape, Context& context) {
  MeshRequest request;
  request.format = MeshFormat::kSerialized;
  request.shape_index = properties.integer("shape_index", 0);
  queue_file(properties, shape, context, std::move(request));
}

}  // namespace metrofarm::scene_file::mitsuba
