#include "scene_file/mitsuba/emitters.h"

#include <algorithm>

#include "scene_file/mitsuba/colours.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Index;
using Model = decltype(scene::Emitter::model);

constexpr scene::Rgb kWhite = {1, 1, 1};

Model load_area(Properties& properties, Context&) {
  return scene::AreaEmitter{read_colour(properties, "radiance", kWhite, ColourUse::kEmission)};
}

Model load_point(Properties& properties, Context& context) {
  const Element* position = properties.find("position");
  if (position && properties.has("to_world")) {
    context.problems.fail("give either position or to_world, not both", position->where);
  }
  scene::PointEmitter emitter;
  emitter.position = position ? properties.point("position", {0, 0, 0})
                              : column(properties.transform("to_world"), 3);
  emitter.intensity = read_colour(properties, "intensity", kWhite, ColourUse::kEmission);
  return emitter;
}

Model load_constant(Properties& properties, Context& context) {
  const bool repeated = std::any_of(
      context.scene.emitters.begin(), context.scene.emitters.end(), [](const auto& emitter) {
        return std::holds_alternative<scene::ConstantEmitter>(emitter.model);
      });
  if (repeated) {
    context.problems.fail("a scene can have only one environment emitter",
                          properties.element().where);
  }
  properties.ignore({"to_world"});
  return scene::ConstantEmitter{read_colour(properties, "radiance", kWhite, ColourUse::kEmission)};
}

constexpr Plugin<Model (*)(Properties&, Context&)> kEmitters[] = {
    {"area", load_area},
    {"point", load_point},
    {"constant", load_constant},
};

Index load_emitter(const Element& element, Context& context) {
  const auto* plugin = find_plugin(kEmitters, element, "it is left out", context.problems);
  if (!plugin) return scene::kNone;
  Properties properties = context.properties_of(element);
  const Model model = plugin->load(properties, context);
  // How often Mitsuba picks this light for sampling: no part of the image.
  properties.ignore({"sampling_weight"});
  properties.finish();
  context.scene.emitters.push_back({model, element.where});
  return static_cast<Index>(context.scene.emitters.size() - 1);
}

}  // namespace

void load_scene_emitter(const Element& element, Context& context) {
  if (element.get("type") != "area") load_emitter(element, context);
}

Index load_area_emitter(const Element& element, Context& context) {
  if (!context.attached_emitters.insert(&element).second) {
    context.problems.fail("an emitter can be attached to one shape only", element.where);
    return scene::kNone;
  }
  const std::string& type = element.get("type");
  if (type == "point" || type == "constant") {
    context.problems.unsupported("only an area emitter can be part of a shape; " +
                                     element.describe() + " belongs directly into the <scene>",
                                 element.where);
    return scene::kNone;
  }
  return load_emitter(element, context);
}

}  // namespace metrofarm::scene_file::mitsuba
