#include "scene_file/mitsuba/sensor_film.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "scene_file/names.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Film;
using scene::ReconstructionFilter;

constexpr double kHuge = std::numeric_limits<double>::max();
constexpr int64_t kMaxInt = std::numeric_limits<int>::max();

double radians(double degrees) {
  return degrees * (std::numbers::pi / 180);
}
double degrees(double radians) {
  return radians * (180 / std::numbers::pi);
}

void load_box(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kBox;
  film.filter_radius = properties.number_in("radius", 0.5, 0.5, 16);
}

void load_tent(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kTent;
  film.filter_radius = properties.number_in("radius", 1, 0.01, 16);
}

void load_gaussian(Properties& properties, Film& film) {
  film.filter = ReconstructionFilter::kGaussian;
  film.filter_stddev = properties.number_in("stddev", 0.5, 0.01, 4);
  film.filter_radius = 4 * film.filter_stddev;  // where Mitsuba cuts it off
}

constexpr Plugin<void (*)(Properties&, Film&)> kFilters[] = {
    {"box", load_box},
    {"tent", load_tent},
    {"gaussian", load_gaussian},
};

void load_filter(const Element& element, Context& context) {
  const auto* plugin =
      find_plugin(kFilters, element, "a gaussian takes its place", context.problems);
  if (!plugin) return;
  Properties properties = context.properties_of(element);
  plugin->load(properties, context.scene.film);
  properties.finish();
}

void refuse_crop(Properties& properties, const Film& film) {
  struct Part {
    std::string_view name;
    int64_t full;
  };
  for (const Part& part : {Part{"crop_offset_x", 0}, Part{"crop_offset_y", 0},
                           Part{"crop_width", film.width}, Part{"crop_height", film.height}}) {
    if (properties.integer(part.name, part.full) == part.full) continue;
    properties.problems().unsupported("crop windows are not supported: \"" +
                                          std::string(part.name) + "\" must be " +
                                          std::to_string(part.full) + ", as for the whole film",
                                      properties.find(part.name)->where);
  }
}

void load_film(const Element& element, Context& context) {
  Film& film = context.scene.film;
  film.where = element.where;
  if (element.get("type") != "hdrfilm") {
    report_unknown_plugin(element, {"hdrfilm"}, "it is read as an hdrfilm", context.problems);
  }
  Properties properties = context.properties_of(element);
  constexpr int64_t kMaxSize = 32768;
  film.width = static_cast<int>(properties.integer_in("width", film.width, 1, kMaxSize));
  film.height = static_cast<int>(properties.integer_in("height", film.height, 1, kMaxSize));
  refuse_crop(properties, film);
  properties.ignore({"pixel_format", "component_format", "file_format", "banner",
                     "high_quality_edges", "sample_border", "compensate"});
  if (const Element* filter = properties.object("rfilter")) load_filter(*filter, context);
  properties.finish();
}

// Every sampler is accepted: only the number of samples is of interest.
void load_sampler(const Element& element, Context& context) {
  Properties properties = context.properties_of(element);
  scene::IntegratorSettings& settings = context.scene.integrator;
  settings.sample_count =
      static_cast<int>(properties.integer_in("sample_count", settings.sample_count, 1, kMaxInt));
  properties.ignore({"seed", "jitter", "dimension", "scramble", "base", "wavefront_size"});
  properties.finish();
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

double read_fov_x(Properties& properties, const Film& film) {
  const double aspect = static_cast<double>(film.width) / film.height;
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

scene::Matrix read_sensor_transform(Properties& properties) {
  const scene::Matrix to_world = properties.transform("to_world");
  constexpr double kTolerance = 1e-3;  // Mitsuba's
  if (deviation_from_rotation(to_world, 1) > kTolerance) {
    properties.problems().fail(
        "the sensor's to_world must only rotate and translate: it scales or shears",
        properties.find("to_world")->where);
  }
  return to_world;
}

void read_clip_planes(Properties& properties, scene::PerspectiveSensor& sensor) {
  sensor.near_clip = properties.number_in("near_clip", sensor.near_clip, 1e-30, kHuge);
  sensor.far_clip = properties.number("far_clip", sensor.far_clip);
  if (sensor.near_clip < sensor.far_clip) return;
  properties.problems().fail("near_clip must be smaller than far_clip", sensor.where);
}

}  // namespace

void load_sensor(const Element& element, Context& context) {
  scene::PerspectiveSensor& sensor = context.scene.sensor;
  sensor.where = element.where;
  if (element.get("type") != "perspective") {
    report_unknown_plugin(element, {"perspective"}, "it is read as a perspective sensor",
                          context.problems);
  }
  Properties properties = context.properties_of(element);
  if (const Element* film = properties.object("film")) load_film(*film, context);
  if (const Element* sampler = properties.object("sampler")) load_sampler(*sampler, context);
  sensor.fov_x_degrees = read_fov_x(properties, context.scene.film);
  sensor.to_world = read_sensor_transform(properties);
  read_clip_planes(properties, sensor);
  sensor.principal_point_offset_x = properties.number("principal_point_offset_x", 0);
  sensor.principal_point_offset_y = properties.number("principal_point_offset_y", 0);
  // A pinhole has no focus, and nothing in the scene moves while the shutter is open.
  properties.ignore({"focus_distance", "shutter_open", "shutter_close"});
  properties.finish();
}

void load_integrator(const Element& element, Context& context) {
  scene::IntegratorSettings& settings = context.scene.integrator;
  const std::string& type = element.get("type");
  Properties properties = context.properties_of(element);
  if (type == "direct") {
    // Emitted light and one bounce: paths of at most two edges.
    settings.max_depth = 2;
    properties.ignore({"shading_samples", "emitter_samples", "bsdf_samples"});
  } else {
    if (type != "path") {
      report_unknown_plugin(element, {"path", "direct"}, "it is read as a path integrator",
                            context.problems);
    }
    settings.max_depth =
        static_cast<int>(properties.integer_in("max_depth", settings.max_depth, -1, kMaxInt));
    settings.rr_depth =
        static_cast<int>(properties.integer_in("rr_depth", settings.rr_depth, 1, kMaxInt));
  }
  settings.hide_emitters = properties.boolean("hide_emitters", settings.hide_emitters);
  properties.ignore({"samples_per_pass", "block_size", "timeout"});
  properties.finish();
}

}  // namespace metrofarm::scene_file::mitsuba
