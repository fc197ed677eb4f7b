#include "scene_file/mitsuba/emitters.h"

#include <algorithm>

#include "scene_file/mitsuba/colours.h"
#include "scene_file/mitsuba/sensor.h"
#include "scene_file/mitsuba/sky.h"
#include "scene_file/mitsuba/textures.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Index;
using Model = decltype(scene::Emitter::model);

constexpr scene::Rgb kWhite = {1, 1, 1};

bool is_environment(const scene::Emitter& emitter) {
  return std::holds_alternative<scene::ConstantEmitter>(emitter.model) ||
         std::holds_alternative<scene::EnvironmentEmitter>(emitter.model);
}

Model load_area(Properties& properties, Context& context) {
  properties.ignore({"caustic_emitter_single", "caustic_emitter_multi"});
  return scene::AreaEmitter{
      read_textured_colour(properties, "radiance", {kWhite}, ColourUse::kEmission, context)};
}

Model load_point(Properties& properties, Context& context) {
  const Element* position = properties.find("position");
  if (position && properties.has("to_world")) {
    context.problems.fail("give either position or to_world, not both", position->where);
  }
  scene::PointEmitter emitter;
  emitter.position = position ? properties.point("position", {0, 0, 0})
                              : column(properties.transform("to_world"), 3);
  emitter.intensity = read_colour(properties, "intensity", kWhite, ColourUse::kEmission, context);
  properties.ignore({"caustic_emitter_single", "caustic_emitter_multi"});
  return emitter;
}

Model load_constant(Properties& properties, Context& context) {
  properties.ignore({"to_world"});
  return scene::ConstantEmitter{
      read_colour(properties, "radiance", kWhite, ColourUse::kEmission, context)};
}

// Fails if the matrix has no inverse.
Matrix read_invertible(Properties& properties) {
  const Matrix to_world = properties.transform("to_world");
  if (!flattens(to_world)) return to_world;
  properties.problems().fail(
      "the to_world of " + properties.element().describe() + " must not flatten space",
      properties.find("to_world")->where);
  return kIdentity;
}

Model load_envmap(Properties& properties, Context& context) {
  scene::EnvironmentEmitter emitter;
  emitter.image = load_image(properties, true, context);
  emitter.scale = static_cast<float>(properties.number_in("scale", 1, 0, 1e30));
  emitter.to_world = read_invertible(properties);
  // How the light is sampled, cached or displayed: no part of the image.
  properties.ignore({"mis_compensation", "cache", "gamma", "caustic_emitter_single"});
  return emitter;
}

Model load_spot(Properties& properties, Context& context) {
  scene::SpotEmitter emitter;
  emitter.to_world = read_invertible(properties);
  const scene::Rgb intensity =
      read_colour(properties, "intensity", kWhite, ColourUse::kEmission, context);
  emitter.intensity =
      read_textured_colour(properties, "texture", {kWhite}, ColourUse::kEmission, context);
  for (int i = 0; i < 3; ++i) emitter.intensity.value[i] *= intensity[i];
  emitter.cutoff_degrees = properties.number("cutoff_angle", 20);
  emitter.beam_width_degrees = properties.number("beam_width", emitter.cutoff_degrees * 3 / 4);
  if (!(emitter.cutoff_degrees > 0 && emitter.cutoff_degrees < 90)) {
    context.problems.fail("cutoff_angle must lie between 0 and 90 degrees",
                          properties.find("cutoff_angle")->where);
  } else if (!(emitter.beam_width_degrees >= 0 &&
               emitter.beam_width_degrees <= emitter.cutoff_degrees)) {
    context.problems.fail("beam_width must lie between 0 and cutoff_angle",
                          properties.find("beam_width")->where);
  }
  return emitter;
}

Model load_directional(Properties& properties, Context& context) {
  scene::DirectionalEmitter emitter;
  const Element* direction = properties.find("direction");
  if (direction && properties.has("to_world")) {
    context.problems.fail("give either direction or to_world, not both", direction->where);
  }
  emitter.direction = direction ? properties.point("direction", {0, 0, 1})
                                : column(properties.transform("to_world"), 2);
  if (length(emitter.direction) == 0) {
    context.problems.fail("the direction of a light must not be zero", properties.element().where);
  }
  emitter.irradiance = read_colour(properties, "irradiance", kWhite, ColourUse::kEmission, context);
  return emitter;
}

// Width over height of the image behind a texture; 1 for others.
double aspect_of(const scene::Colour& colour, const scene::SceneDescription& scene) {
  if (colour.texture == scene::kNone) return 1;
  const auto* bitmap = std::get_if<scene::BitmapTexture>(&scene.textures[colour.texture].model);
  if (!bitmap || bitmap->image == scene::kNone) return 1;
  const scene::Image& image = scene.images[bitmap->image];
  return static_cast<double>(image.width) / image.height;
}

Model load_projector(Properties& properties, Context& context) {
  scene::ProjectorEmitter emitter;
  emitter.to_world = read_invertible(properties);
  emitter.irradiance =
      read_textured_colour(properties, "irradiance", {kWhite}, ColourUse::kEmission, context);
  if (context.problems.failed()) return emitter;
  const auto scale = static_cast<float>(properties.number_in("scale", 1, 0, 1e30));
  for (float& channel : emitter.irradiance.value) channel *= scale;
  emitter.aspect = aspect_of(emitter.irradiance, context.scene);
  emitter.fov_x_degrees = read_fov_x(properties, emitter.aspect);
  return emitter;
}

constexpr Plugin<Model (*)(Properties&, Context&)> kEmitters[] = {
    {"area", load_area},
    {"point", load_point},
    {"constant", load_constant},
    {"envmap", load_envmap},
    {"spot", load_spot},
    {"directional", load_directional},
    {"projector", load_projector},
    {"sunsky", load_sky},
    {"sky", load_sky},
    {"sun", load_sky},
};

// Those whose to_world may be an <animation>.
constexpr std::string_view kMoving[] = {"point", "spot", "directional", "projector"};

Index load_emitter(const Element& element, Context& context) {
  const auto* plugin = find_plugin(kEmitters, element, "it is left out", context.problems);
  if (!plugin) return scene::kNone;
  Properties properties = context.properties_of(element);
  const bool can_move =
      std::find(std::begin(kMoving), std::end(kMoving), plugin->type) != std::end(kMoving);
  scene::Motion motion = can_move ? properties.motion("to_world") : scene::Motion{};
  scene::Emitter emitter = {plugin->load(properties, context), element.where, std::move(motion)};
  // How often Mitsuba picks this light for sampling: no part of the image.
  properties.ignore({"sampling_weight"});
  properties.finish();
  std::vector<scene::Emitter>& emitters = context.scene.emitters;
  if (is_environment(emitter) && std::any_of(emitters.begin(), emitters.end(), is_environment)) {
    context.problems.fail("a scene can have only one environment emitter", element.where);
  }
  emitters.push_back(std::move(emitter));
  return static_cast<Index>(emitters.size() - 1);
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
  const bool known = std::any_of(std::begin(kEmitters), std::end(kEmitters),
                                 [&](const auto& plugin) { return plugin.type == type; });
  if (known && type != "area") {
    context.problems.unsupported("only an area emitter can be part of a shape; " +
                                     element.describe() + " belongs directly into the <scene>",
                                 element.where);
    return scene::kNone;
  }
  return load_emitter(element, context);
}

}  // namespace metrofarm::scene_file::mitsuba
