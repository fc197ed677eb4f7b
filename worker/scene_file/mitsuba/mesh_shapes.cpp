#include "scene_file/mitsuba/mesh_shapes.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "motion/track.h"
#include "scene_file/names.h"
#include "scene_file/numbers.h"

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
  request.options.mirrored_later = motion::mirrors(shape.motion);
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

// Names between commas.
std::vector<std::string> split_names(std::string_view list) {
  std::vector<std::string> names;
  while (!list.empty()) {
    const size_t comma = std::min(list.find(','), list.size());
    names.emplace_back(trim(list.substr(0, comma)));
    list.remove_prefix(std::min(comma + 1, list.size()));
  }
  return names;
}

// A key of a mesh that deforms.
struct MeshKey {
  double time;
  std::string file;
};

std::vector<MeshKey> read_keys(Properties& properties, const SourceLocation& where,
                               Problems& problems) {
  const std::vector<std::string> names = split_names(properties.text("filename", ""));
  const auto times = parse_doubles(properties.text("times", ""));
  if (names.size() < 2 || !times || times->size() != names.size()) {
    problems.fail(properties.element().describe() +
                      " needs a \"filename\" with two or more ply files between commas, and "
                      "\"times\" with as many numbers",
                  where);
    return {};
  }
  std::vector<MeshKey> keys;
  for (size_t i = 0; i < names.size(); ++i) keys.push_back({(*times)[i], names[i]});
  std::stable_sort(keys.begin(), keys.end(),
                   [](const MeshKey& a, const MeshKey& b) { return a.time < b.time; });
  for (size_t i = 1; i < keys.size(); ++i) {
    if (keys[i].time != keys[i - 1].time) continue;
    problems.fail("two files of " + properties.element().describe() + " have the same time",
                  properties.find("times")->where);
    return {};
  }
  return keys;
}

}  // namespace

void load_deformable(Properties& properties, scene::Shape& shape, Context& context) {
  if (shape.group != scene::kNone) {
    return context.problems.fail("a mesh that deforms cannot be part of a shapegroup", shape.where);
  }
  MeshRequest request;
  request.format = MeshFormat::kPly;
  request.options.flip_tex_coords = properties.boolean("flip_tex_coords", false);
  request.options.to_world = properties.transform("to_world");
  request.options.mirrored_later = motion::mirrors(shape.motion);
  request.options.face_normals = properties.boolean("face_normals", false);
  request.shape = context.scene.shapes.size();
  request.name = properties.element().describe() + (shape.id.empty() ? "" : " " + shape.id);
  for (const MeshKey& key : read_keys(properties, shape.where, context.problems)) {
    request.where = properties.find("filename")->where;
    const Result<std::filesystem::path> path = context.files.find(key.file);
    if (!path) return context.problems.fail(path.error().message, request.where);
    request.file = path.value();
    request.key = shape.key_times.size();
    shape.key_times.push_back(key.time);
    context.meshes.add(MeshRequest(request), context.files);
  }
}

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
