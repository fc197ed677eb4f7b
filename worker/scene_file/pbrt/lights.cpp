#include "scene_file/pbrt/lights.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene_file/pbrt/colours.h"
#include "scene_file/pbrt/environment.h"
#include "scene_file/pbrt/shapes.h"

namespace metrofarm::scene_file::pbrt {
namespace {

constexpr double kPi = std::numbers::pi;

struct Loader {
  Parameters& parameters;
  const Matrix& to_world;
  Context& context;

  Problems& problems() const { return context.problems; }
};

Rgb times(const Rgb& rgb, double factor) {
  return {static_cast<float>(rgb[0] * factor), static_cast<float>(rgb[1] * factor),
          static_cast<float>(rgb[2] * factor)};
}

void add(const Loader& loader, decltype(scene::Emitter::model) model) {
  loader.context.scene.emitters.push_back({model, loader.parameters.where()});
}

double read_scale(const Loader& loader) {
  const double scale = loader.parameters.number("scale", 1, loader.problems());
  if (!(scale >= 0)) {
    loader.problems().fail("\"scale\" of a light must not be negative", loader.parameters.where());
  }
  return scale * loader.context.imaging_ratio;
}

// The colour "name" times "scale"; where `total` (such as "power") is given, divided by what a
// light of luminance 1 has of it.
Rgb read_emission_of(const Loader& loader, std::string_view name, std::string_view total,
                     double total_of_one) {
  const Rgb colour = read_emission(loader.parameters, name, loader.context);
  const double wanted = loader.parameters.number(total, -1, loader.problems());
  return times(colour, read_scale(loader) * (wanted > 0 ? wanted / total_of_one : 1));
}

void load_point(const Loader& loader) {
  scene::PointEmitter light;
  light.intensity = read_emission_of(loader, "I", "power", 4 * kPi);
  light.position = transform_point(loader.to_world,
                                   loader.parameters.point("from", {0, 0, 0}, loader.problems()));
  add(loader, light);
}

// From "from" to "to" in world space.
std::pair<Point, Point> read_axis(const Loader& loader) {
  const Point from = loader.parameters.point("from", {0, 0, 0}, loader.problems());
  const Point to = loader.parameters.point("to", {0, 0, 1}, loader.problems());
  const Point world_from = transform_point(loader.to_world, from);
  const Point world_to = transform_point(loader.to_world, to);
  if (length(subtract(world_to, world_from)) == 0) {
    loader.problems().fail("\"from\" and \"to\" of a light must be different points",
                           loader.parameters.where());
  }
  return {world_from, world_to};
}

void load_spot(const Loader& loader) {
  scene::SpotEmitter light;
  light.cutoff_degrees = loader.parameters.number("coneangle", 30, loader.problems());
  const double delta = loader.parameters.number("conedeltaangle", 5, loader.problems());
  light.beam_width_degrees = light.cutoff_degrees - delta;
  if (!(light.cutoff_degrees > 0 && light.cutoff_degrees < 180 && delta >= 0 &&
        light.beam_width_degrees >= 0)) {
    return loader.problems().fail(
        "\"coneangle\" must lie between 0 and 180 and \"conedeltaangle\" between 0 and it",
        loader.parameters.where());
  }
  const double cos_end = std::cos(light.cutoff_degrees * kPi / 180);
  const double cos_start = std::cos(light.beam_width_degrees * kPi / 180);
  const double power_of_one = 2 * kPi * ((1 - cos_start) + (cos_start - cos_end) / 2);
  light.intensity = {read_emission_of(loader, "I", "power", power_of_one)};
  const auto [from, to] = read_axis(loader);
  const Point axis = normalized(subtract(to, from));
  const std::optional<Matrix> placed = look_at(from, to, any_perpendicular(axis));
  if (!placed) return;
  light.to_world = *placed;
  if (delta > 0) {
    loader.problems().warn(
        "a spot light's edge falls off linearly in the angle, not as a "
        "smooth step of its cosine",
        loader.parameters.where());
  }
  add(loader, light);
}

void load_distant(const Loader& loader) {
  scene::DirectionalEmitter light;
  light.irradiance = read_emission_of(loader, "L", "illuminance", 1);
  const auto [from, to] = read_axis(loader);
  light.direction = normalized(subtract(to, from));
  add(loader, light);
}

// The rotation (perhaps mirroring) of the transform; an environment has no place and no size.
Matrix orientation_of(const Loader& loader) {
  const Matrix& m = loader.to_world;
  const double scale = length(column(m, 0));
  constexpr double kTolerance = 1e-4;
  if (!(scale > 0) || deviation_from_rotation(m, scale) > kTolerance * scale * scale) {
    loader.problems().fail(
        "the transform of an infinite light with an image must scale equally "
        "in all directions",
        loader.parameters.where());
    return kIdentity;
  }
  Matrix orientation = kIdentity;
  for (size_t row = 0; row < 3; ++row) {
    for (size_t col = 0; col < 3; ++col) orientation[4 * row + col] = m[4 * row + col] / scale;
  }
  return orientation;
}

void load_environment_map(const Loader& loader, const std::string& name) {
  Context& context = loader.context;
  const SourceLocation& where = loader.parameters.where();
  const scene::Index index = read_named_image(name, false, where, context);
  if (index == scene::kNone) return;
  scene::Image& image = context.scene.images[static_cast<size_t>(index)];
  double scale = read_scale(loader);
  const double wanted = loader.parameters.number("illuminance", -1, context.problems);
  if (wanted > 0) {
    const double of_map = upward_illuminance(image);
    if (!(of_map > 0)) {
      return context.problems.fail("\"illuminance\" needs a map with light in its upper half",
                                   where);
    }
    scale *= wanted / of_map;
  }
  Result<scene::Image> converted = to_latitude_longitude(image);
  if (!converted) return context.problems.fail(name + ": " + converted.error().message, where);
  image = std::move(converted.value());
  if (const auto error = context.files.memory().take(image)) {
    return context.problems.fail(name + ": " + error->message, where);
  }
  add(loader, scene::EnvironmentEmitter{index, static_cast<float>(scale), orientation_of(loader)});
}

void load_infinite(const Loader& loader) {
  if (loader.parameters.find("portal")) {
    loader.problems().warn("the portal is not needed: the light shines from all around",
                           loader.parameters.where());
  }
  const std::string name = loader.parameters.text("filename", "", loader.problems());
  if (name.empty()) {
    return add(loader, scene::ConstantEmitter{read_emission_of(loader, "L", "illuminance", kPi)});
  }
  if (loader.parameters.find("L")) {
    return loader.problems().fail("give an infinite light either \"L\" or \"filename\", not both",
                                  loader.parameters.where());
  }
  load_environment_map(loader, name);
}

struct Row {
  std::string_view type;
  void (*load)(const Loader&);
};

constexpr Row kLights[] = {
    {"point", load_point},
    {"spot", load_spot},
    {"distant", load_distant},
    {"infinite", load_infinite},
};

}  // namespace

void load_light(Entity& entity, const Matrix& to_world, Context& context) {
  std::vector<std::string_view> supported;
  for (const Row& row : kLights) {
    supported.push_back(row.type);
    if (row.type != entity.type) continue;
    row.load({entity.parameters, to_world, context});
    return entity.parameters.finish("light \"" + entity.type + "\"", context.problems);
  }
  report_unknown_plugin("light", entity, supported, "it is left out", context.problems);
}

AreaLight read_area_light(Entity& entity, Context& context) {
  AreaLight light;
  light.where = entity.where();
  if (entity.type != "diffuse") {
    report_unknown_plugin("area light", entity, {"diffuse"}, "it is read as diffuse",
                          context.problems);
  }
  const Loader loader{entity.parameters, kIdentity, context};
  light.radiance = times(read_emission(entity.parameters, "L", context), read_scale(loader));
  light.power = entity.parameters.number("power", 0, context.problems);
  light.two_sided = entity.parameters.boolean("twosided", false, context.problems);
  if (entity.parameters.find("filename")) {
    context.problems.unsupported("area lights with an image are not supported: give \"L\"",
                                 light.where);
  }
  entity.parameters.finish("area light \"" + entity.type + "\"", context.problems);
  return light;
}

scene::Index add_area_emitter(const AreaLight& light, const scene::Shape& shape, Context& context) {
  Rgb radiance = light.radiance;
  if (light.power > 0) {
    std::vector<double> areas = areas_of(shape, context.scene.sensor.shutter_open);
    std::sort(areas.begin(), areas.end());
    constexpr double kTolerance = 1e-3;
    if (areas.back() - areas.front() > kTolerance * areas.back()) {
      context.problems.unsupported(
          "the \"power\" of a light holds for each triangle; for meshes "
          "of unequal triangles it is not supported: give \"L\"",
          light.where);
    }
    const double area = areas[areas.size() / 2];
    if (area > 0)
      radiance = times(radiance, light.power / (area * kPi * (light.two_sided ? 2 : 1)));
  }
  return append(context.scene.emitters, {scene::AreaEmitter{{radiance}}, light.where});
}

}  // namespace metrofarm::scene_file::pbrt
