#include "scene_file/mitsuba/sensor.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "scene_file/mitsuba/film.h"
#include "scene_file/names.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Film;

constexpr double kHuge = std::numeric_limits<double>::max();

double radians(double degrees) {
  return degrees * (std::numbers::pi / 180);
}
double degrees(double radians) {
  return radians * (180 / std::numbers::pi);
}

// "50mm" on 35 mm film (36 x 24 mm): the angle along the film's diagonal.
double diagonal_fov_of_focal_length(Properties& properties) {
  std::string text(trim(properties.text("focal_length", "50mm")));
  if (text.ends_with("mm")) text.resize(text.size() - 2);
  const std::optional<double> millimetres = parse_double(text);
  if (!millimetres || !(*millimetres > 0)) {
    properties.problems().fail(
        "focal_length must be a positive number of millimetres such as \"50mm\"",
        properties.find("focal_length")->where);
    return 90;
  }
  return degrees(2 * std::atan(std::hypot(36.0, 24.0) / 2 / *millimetres));
}

// The horizontal angle of a film when the given one is along `axis`.
double to_horizontal(double fov, const std::string& axis, double aspect) {
  const double tangent = std::tan(radians(fov) / 2);
  const bool wide = aspect > 1;
  if (axis == "y" || axis == (wide ? "smaller" : "larger")) {
    return degrees(2 * std::atan(tangent * aspect));
  }
  if (axis == "diagonal") {
    return degrees(2 * std::atan(tangent / std::sqrt(1 + 1 / (aspect * aspect))));
  }
  return fov;
}

double aspect_of(const Film& film) {
  return static_cast<double>(film.width) / film.height;
}

// The orthographic sensor's extent is its scale; the others must not have one.
void check_pose(Properties& properties, const scene::Sensor& sensor, const scene::Matrix& m) {
  constexpr double kTolerance = 1e-3;  // Mitsuba's
  const Element* element = properties.find("to_world");
  if (sensor.projection != scene::Projection::kOrthographic) {
    if (deviation_from_rotation(m, 1) <= kTolerance) return;
    properties.problems().fail(
        "the sensor's to_world must only rotate and translate: it scales or shears",
        element->where);
  } else if (determinant(m) == 0) {
    properties.problems().fail("the sensor's to_world must not flatten space", element->where);
  }
}

void check_transform(Properties& properties, const scene::Sensor& sensor) {
  if (sensor.motion.empty()) return check_pose(properties, sensor, sensor.to_world);
  for (const scene::Keyframe& key : sensor.motion.keys)
    check_pose(properties, sensor, key.to_world);
}

void read_clip_planes(Properties& properties, scene::Sensor& sensor) {
  sensor.near_clip = properties.number_in("near_clip", sensor.near_clip, 1e-30, kHuge);
  sensor.far_clip = properties.number("far_clip", sensor.far_clip);
  if (sensor.near_clip < sensor.far_clip) return;
  properties.problems().fail("near_clip must be smaller than far_clip", sensor.where);
}

void read_shutter(Properties& properties, scene::Sensor& sensor) {
  sensor.shutter_open = properties.number("shutter_open", 0);
  sensor.shutter_close = properties.number("shutter_close", sensor.shutter_open);
  const double open_time = sensor.shutter_close - sensor.shutter_open;
  if (open_time >= 0 && std::isfinite(open_time)) return;
  properties.problems().fail("shutter_close must not be before shutter_open", sensor.where);
}

void load_perspective(Properties& properties, scene::Sensor& sensor, const Film& film) {
  sensor.projection = scene::Projection::kPerspective;
  sensor.fov_x_degrees = read_fov_x(properties, aspect_of(film));
  properties.ignore({"focus_distance"});  // a pinhole has no focus
}

void load_thin_lens(Properties& properties, scene::Sensor& sensor, const Film& film) {
  sensor.projection = scene::Projection::kThinLens;
  sensor.fov_x_degrees = read_fov_x(properties, aspect_of(film));
  if (!properties.has("aperture_radius")) {
    properties.problems().fail("a thinlens sensor needs an \"aperture_radius\"", sensor.where);
    return;
  }
  sensor.aperture_radius = properties.number_in("aperture_radius", 0, 0, kHuge);
  // Where nothing is given, Mitsuba focuses on its far clip plane.
  const double far_clip = properties.number("far_clip", sensor.far_clip);
  sensor.focus_distance = properties.number("focus_distance", far_clip);
  if (sensor.focus_distance > 0) return;
  properties.problems().fail("focus_distance must be greater than 0", sensor.where);
}

void load_orthographic(Properties& properties, scene::Sensor& sensor, const Film&) {
  sensor.projection = scene::Projection::kOrthographic;
  properties.ignore({"focus_distance"});
}

constexpr Plugin<void (*)(Properties&, scene::Sensor&, const Film&)> kSensors[] = {
    {"perspective", load_perspective},
    {"thinlens", load_thin_lens},
    {"orthographic", load_orthographic},
};

}  // namespace

double read_fov_x(Properties& properties, double aspect) {
  const std::string axis = lower_case(properties.text("fov_axis", "x"));
  if (axis != "x" && axis != "y" && axis != "diagonal" && axis != "smaller" && axis != "larger") {
    properties.problems().fail("unknown fov_axis \"" + axis + "\"" +
                                   suggestion(axis, {"x", "y", "diagonal", "smaller", "larger"}),
                               properties.find("fov_axis")->where);
  }
  const Element* fov = properties.find("fov");
  if (!fov) return to_horizontal(diagonal_fov_of_focal_length(properties), "diagonal", aspect);
  if (properties.has("focal_length")) {
    properties.problems().fail("give either fov or focal_length, not both", fov->where);
  }
  const double angle = properties.number("fov", 90);
  if (!(angle > 0 && angle < 180)) {
    properties.problems().fail("fov must lie between 0 and 180 degrees", fov->where);
    return 90;
  }
  return to_horizontal(angle, axis, aspect);
}

void load_sensor(const Element& element, Context& context) {
  scene::Sensor& sensor = context.scene.sensor;
  sensor.where = element.where;
  const auto* plugin =
      find_plugin(kSensors, element, "it is read as a perspective sensor", context.problems);
  Properties properties = context.properties_of(element);
  if (const Element* film = properties.object("film")) load_film(*film, context);
  if (const Element* sampler = properties.object("sampler")) load_sampler(*sampler, context);
  (plugin ? plugin->load : load_perspective)(properties, sensor, context.scene.film);
  read_shutter(properties, sensor);
  sensor.motion = properties.motion("to_world");
  sensor.to_world = properties.transform("to_world");
  check_transform(properties, sensor);
  read_clip_planes(properties, sensor);
  sensor.principal_point_offset_x = properties.number("principal_point_offset_x", 0);
  sensor.principal_point_offset_y = properties.number("principal_point_offset_y", 0);
  properties.finish();
}

}  // namespace metrofarm::scene_file::mitsuba
