#include "scene_file/mitsuba/shapes.h"

#include <optional>
#include <utility>

#include "scene_file/mitsuba/bsdfs.h"
#include "scene_file/mitsuba/emitters.h"
#include "scene_file/mitsuba/mesh_shapes.h"
#include "scene_file/mitsuba/primitive_shapes.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Index;
using scene::Shape;

constexpr Plugin<void (*)(Properties&, Shape&, Context&)> kShapes[] = {
    {"rectangle", load_rectangle},
    {"cube", load_cube},
    {"sphere", load_sphere},
    {"disk", load_disk},
    {"cylinder", load_cylinder},
    {"obj", load_obj},
    {"ply", load_ply},
    {"serialized", load_serialized},
    {"deformable", load_deformable},
};

Index null_bsdf(Context& context) {
  if (context.null_bsdf == scene::kNone) {
    context.null_bsdf = static_cast<Index>(context.scene.bsdfs.size());
    context.scene.bsdfs.push_back({scene::Null{}, "", {}});
  }
  return context.null_bsdf;
}

// The nested material, or the one that Mitsuba gives to shapes without: none is seen of the mere
// boundary of a medium.
Index read_material(Properties& properties, bool is_light, Context& context) {
  if (const Element* bsdf = properties.object("bsdf")) return load_bsdf(*bsdf, context);
  if (properties.has_object("medium") && !is_light) return null_bsdf(context);
  return default_bsdf(is_light, context);
}

void load_light(Properties& properties, Shape& shape, Context& context) {
  const Element* emitter = properties.object("emitter");
  if (!emitter) return;
  if (shape.group != scene::kNone) {
    return context.problems.fail("a shape inside a shapegroup cannot be a light", emitter->where);
  }
  shape.area_emitter = load_area_emitter(*emitter, context);
}

void take_object(const Element& element, Context& context) {
  if (const std::optional<Error> error = context.files.memory().take_object()) {
    context.problems.fail(error->message, element.where);
  }
}

void load_single_shape(const Element& element, Index group, Context& context) {
  const auto* plugin = find_plugin(kShapes, element, "it is left out", context.problems);
  if (!plugin) return;
  Properties properties = context.properties_of(element);
  Shape shape;
  shape.id = element.get("id");
  shape.where = element.where;
  shape.group = group;
  shape.flip_normals = properties.boolean("flip_normals", false);
  if (group == scene::kNone) shape.motion = properties.motion("to_world");
  plugin->load(properties, shape, context);
  load_light(properties, shape, context);
  shape.bsdf = read_material(properties, shape.area_emitter != scene::kNone, context);
  // Hints of papers to their own integrators are among them.
  properties.ignore({"silhouette_sampling_weight", "caustic_receiver", "caustic_bouncer",
                     "caustic_caster_single", "caustic_caster_multi", "glinty"});
  properties.finish();
  take_object(element, context);
  context.scene.shapes.push_back(std::move(shape));
}

void load_into(const Element& element, Index group, Context& context);

void load_children(Properties& properties, Index group, Context& context) {
  for (const Element* child : properties.objects("shape")) load_into(*child, group, context);
  properties.finish();
}

// The number of the group, which is loaded if this is its first instance.
Index group_of(const Element& element, Context& context) {
  const auto [it, added] =
      context.groups.emplace(&element, static_cast<Index>(context.groups.size()));
  if (!added) return it->second;
  const Index group = it->second;
  const size_t first = context.scene.shapes.size();
  Properties properties = context.properties_of(element);
  load_children(properties, group, context);
  if (context.scene.shapes.size() == first) {
    context.problems.unsupported("a shapegroup needs at least one shape", element.where);
  }
  return group;
}

void load_instance(const Element& element, Context& context) {
  Properties properties = context.properties_of(element);
  const Element* group = properties.object("shape");
  if (!group || group->get("type") != "shapegroup") {
    return context.problems.fail(
        "an instance needs a shapegroup: <ref id=\"...\"/> to a <shape type=\"shapegroup\">",
        element.where);
  }
  scene::Instance instance;
  instance.motion = properties.motion("to_world");
  instance.to_world = properties.transform("to_world");
  instance.where = element.where;
  if (flattens(instance.to_world)) {
    context.problems.fail("an instance's to_world must not flatten it",
                          properties.find("to_world")->where);
  }
  instance.group = group_of(*group, context);
  properties.finish();
  take_object(element, context);
  context.scene.instances.push_back(std::move(instance));
}

void load_into(const Element& element, Index group, Context& context) {
  // References let few lines stand for any number of shapes: stop at the first problem.
  if (context.problems.failed()) return;
  const std::string& type = element.get("type");
  if (type != "instance" && type != "shapegroup" && type != "merge") {
    return load_single_shape(element, group, context);
  }
  constexpr size_t kMaxNesting = 16;
  if (context.shapes_in_progress.size() >= kMaxNesting) {
    return context.problems.fail("shapes are nested more than 16 deep", element.where);
  }
  if (!context.shapes_in_progress.insert(&element).second) {
    return context.problems.fail(element.describe() + " contains itself", element.where);
  }
  if (group != scene::kNone && type != "merge") {
    context.problems.fail(element.describe() + " has no place inside a shapegroup", element.where);
  } else if (type == "instance") {
    load_instance(element, context);
  } else if (type == "merge") {
    // Mitsuba makes one mesh of the children that look the same: no part of the image.
    Properties properties = context.properties_of(element);
    load_children(properties, group, context);
  }
  context.shapes_in_progress.erase(&element);
}

}  // namespace

void load_shape(const Element& element, Context& context) {
  load_into(element, scene::kNone, context);
}

}  // namespace metrofarm::scene_file::mitsuba
