#include "scene_file/pbrt/camera_film.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "scene_file/names.h"

namespace metrofarm::scene_file::pbrt {
namespace {

using scene::Film;
using scene::ReconstructionFilter;

constexpr double kLargestRadius = 16;

// A radius for both axes.
double read_radius(Parameters& parameters, double fallback, Problems& problems) {
  const double x = parameters.positive("xradius", fallback, problems);
  const double y = parameters.positive("yradius", fallback, problems);
  if (x != y) {
    problems.unsupported("a filter must have the same radius in x and y", parameters.where());
  }
  if (x > kLargestRadius) problems.fail("a filter's radius must be at most 16", parameters.where());
  return x;
}

void load_box(Parameters& parameters, Film& film, Problems& problems) {
  film.filter = ReconstructionFilter::kBox;
  film.filter_radius = read_radius(parameters, 0.5, problems);
}

void load_triangle(Parameters& parameters, Film& film, Problems& problems) {
  film.filter = ReconstructionFilter::kTent;
  film.filter_radius = read_radius(parameters, 2, problems);
}

void load_gaussian(Parameters& parameters, Film& film, Problems& problems) {
  film.filter = ReconstructionFilter::kGaussian;
  film.filter_radius = read_radius(parameters, 1.5, problems);
  film.filter_stddev = parameters.positive("sigma", 0.5, problems);
}

void load_mitchell(Parameters& parameters, Film& film, Problems& problems) {
  film.filter = ReconstructionFilter::kMitchell;
  film.filter_radius = read_radius(parameters, 2, problems);
  film.mitchell_b = parameters.number("B", 1.0 / 3, problems);
  film.mitchell_c = parameters.number("C", 1.0 / 3, problems);
}

void load_sinc(Parameters& parameters, Film& film, Problems& problems) {
  film.filter = ReconstructionFilter::kLanczos;
  film.filter_radius = read_radius(parameters, 4, problems);
  const double tau = parameters.positive("tau", 3, problems);
  if (tau != film.filter_radius) {
    problems.warn("a sinc filter's window ends at its radius: \"tau\" is taken for both",
                  parameters.where());
    if (tau > kLargestRadius) problems.fail("\"tau\" must be at most 16", parameters.where());
    film.filter_radius = tau;
  }
}

struct FilterRow {
  std::string_view type;
  void (*load)(Parameters&, Film&, Problems&);
};

constexpr FilterRow kFilters[] = {{"box", load_box},
                                  {"triangle", load_triangle},
                                  {"gaussian", load_gaussian},
                                  {"mitchell", load_mitchell},
                                  {"sinc", load_sinc}};

void load_filter(Entity& entity, Context& context) {
  std::vector<std::string_view> supported;
  for (const FilterRow& row : kFilters) {
    supported.push_back(row.type);
    if (row.type != entity.type) continue;
    row.load(entity.parameters, context.scene.film, context.problems);
    return entity.parameters.finish("filter \"" + entity.type + "\"", context.problems);
  }
  report_unknown_plugin("filter", entity, supported, "a gaussian takes its place",
                        context.problems);
  load_gaussian(entity.parameters, context.scene.film, context.problems);
}

// Pixels [low, high) of the film's width or height.
struct Range {
  int low, high;
};

void set_crop(const Range& x, const Range& y, const SourceLocation& where, Context& context) {
  Film& film = context.scene.film;
  const auto inside = [](const Range& r, int size) {
    return r.low >= 0 && r.low < r.high && r.high <= size;
  };
  if (!inside(x, film.width) || !inside(y, film.height)) {
    return context.problems.fail("the crop window must lie inside the film and hold a pixel",
                                 where);
  }
  if (x.high - x.low == film.width && y.high - y.low == film.height) return;
  film.crop = {x.low, y.low, x.high - x.low, y.high - y.low};
}

void load_crop(Parameters& parameters, Context& context) {
  const Film& film = context.scene.film;
  Problems& problems = context.problems;
  const bool by_pixels = parameters.find("pixelbounds") != nullptr;
  const bool by_fraction = parameters.find("cropwindow") != nullptr;
  const std::vector<double> pixels =
      parameters.take_numbers("pixelbounds", ParameterType::kInteger, problems);
  const std::vector<double> fractions =
      parameters.take_numbers("cropwindow", ParameterType::kFloat, problems);
  if ((by_pixels && pixels.size() != 4) || (by_fraction && fractions.size() != 4)) {
    return problems.fail("a crop window is four numbers: x0 x1 y0 y1", parameters.where());
  }
  const auto whole = [](double value) {
    return static_cast<int>(std::clamp(value, -1.0, 1.0 + (1 << 20)));
  };
  if (by_pixels) {
    set_crop({whole(pixels[0]), whole(pixels[1])}, {whole(pixels[2]), whole(pixels[3])},
             parameters.where(), context);
  } else if (by_fraction) {
    const auto at = [&](double fraction, int size) { return whole(std::ceil(fraction * size)); };
    set_crop({at(fractions[0], film.width), at(fractions[1], film.width)},
             {at(fractions[2], film.height), at(fractions[3], film.height)}, parameters.where(),
             context);
  }
}

void load_film(Entity& entity, Context& context) {
  Parameters& parameters = entity.parameters;
  Problems& problems = context.problems;
  Film& film = context.scene.film;
  film.where = entity.where();
  constexpr std::array<std::string_view, 3> kTypes = {"rgb", "gbuffer", "spectral"};
  if (std::find(kTypes.begin(), kTypes.end(), entity.type) == kTypes.end()) {
    report_unknown_plugin("film", entity, {kTypes.begin(), kTypes.end()}, "it is read as rgb",
                          problems);
  }
  film.width = parameters.integer_in("xresolution", 1280, 1, problems);
  film.height = parameters.integer_in("yresolution", 720, 1, problems);
  constexpr int kMaxSize = 32768;
  if (film.width > kMaxSize || film.height > kMaxSize) {
    problems.fail("a film must have at most 32768 pixels in each direction", film.where);
    film.width = film.height = 1;
  }
  load_crop(parameters, context);
  context.imaging_ratio = parameters.positive("iso", 100, problems) / 100;
  const std::string sensor = parameters.text("sensor", "cie1931", problems);
  if (sensor != "cie1931") {
    problems.warn("the film's sensor \"" + sensor + "\" is read as \"cie1931\": colours differ",
                  film.where);
  }
  if (parameters.number("whitebalance", 0, problems) != 0) {
    problems.warn("the film's white balance is ignored: colours differ", film.where);
  }
  parameters.ignore({"filename", "savefp16", "diagonal", "maxcomponentvalue", "coordinatesystem",
                     "nbuckets", "lambdamin", "lambdamax"});
  parameters.finish("film \"" + entity.type + "\"", problems);
}

// What the camera sees of the plane z = 1 (before the field of view): x0 x1 y0 y1.
std::array<double, 4> read_screen_window(Parameters& parameters, Context& context) {
  const Film& film = context.scene.film;
  Problems& problems = context.problems;
  const double aspect = static_cast<double>(film.width) / film.height;
  const double frame = parameters.positive("frameaspectratio", aspect, problems);
  std::array<double, 4> window = {-1, 1, -1 / frame, 1 / frame};
  if (frame > 1) window = {-frame, frame, -1, 1};
  const bool given = parameters.find("screenwindow") != nullptr;
  const std::vector<double> numbers =
      parameters.take_numbers("screenwindow", ParameterType::kFloat, problems);
  if (given && (numbers.size() != 4 || !(numbers[0] < numbers[1] && numbers[2] < numbers[3]))) {
    problems.fail("\"screenwindow\" must be four numbers x0 x1 y0 y1 with x0 < x1 and y0 < y1",
                  parameters.where());
  } else if (given) {
    std::copy(numbers.begin(), numbers.end(), window.begin());
  }
  constexpr double kTolerance = 1e-3;
  const double shape = (window[1] - window[0]) / (window[3] - window[2]);
  if (std::abs(shape / aspect - 1) > kTolerance) {
    problems.unsupported(
        "pixels must be square: the screen window and the film must have the "
        "same width per height",
        parameters.where());
  }
  return window;
}

// Camera space of pbrt has +x to the right of the image, ours to the left.
Matrix place_camera(const Matrix& world_from_camera, const SourceLocation& where, double& scale,
                    Context& context) {
  Matrix placed = multiply(world_from_camera, scaling({-1, 1, 1}));
  scale = length(column(placed, 0));
  constexpr double kTolerance = 1e-3;
  if (!(scale > 0) || deviation_from_rotation(placed, scale) > kTolerance * scale * scale) {
    context.problems.fail("the camera's transform must scale equally in all directions", where);
    return kIdentity;
  }
  for (size_t row = 0; row < 3; ++row) {
    for (size_t col = 0; col < 3; ++col) placed[4 * row + col] /= scale;
  }
  return placed;
}

void load_shutter(Parameters& parameters, Context& context) {
  const double open = parameters.number("shutteropen", 0, context.problems);
  const double close = parameters.number("shutterclose", 1, context.problems);
  if (!(close > open) || !std::isfinite(close - open)) {
    return context.problems.fail("\"shutterclose\" must be later than \"shutteropen\"",
                                 parameters.where());
  }
  context.imaging_ratio *= close - open;
  context.scene.sensor.shutter_open = open;
  context.scene.sensor.shutter_close = close;
}

// Returns what one unit of camera space is in the world.
double place_sensor(const RenderingOptions& options, Context& context) {
  scene::Sensor& sensor = context.scene.sensor;
  const SourceLocation where = options.camera.where();
  double scale = 1;
  sensor.motion = motion_between(options.world_from_camera, where, context);
  if (sensor.motion.empty())
    sensor.to_world = place_camera(options.world_from_camera[0], where, scale, context);
  double first = 0;
  for (scene::Keyframe& key : sensor.motion.keys) {
    key.to_world = place_camera(key.to_world, where, scale, context);
    if (first == 0) first = scale;
    if (std::abs(scale - first) > 1e-3 * first) {
      context.problems.fail("the camera's transform must have the same scale at both times", where);
      break;
    }
  }
  return scale;
}

void load_perspective(Parameters& parameters, double scale, Context& context) {
  scene::Sensor& sensor = context.scene.sensor;
  Problems& problems = context.problems;
  const std::array<double, 4> window = read_screen_window(parameters, context);
  const double fov = parameters.positive("fov", 90, problems);
  if (fov >= 180) {
    return problems.fail("\"fov\" must lie between 0 and 180 degrees", parameters.where());
  }
  const double tangent = std::tan(fov * std::numbers::pi / 360);
  const double width = window[1] - window[0];
  const double height = window[3] - window[2];
  sensor.fov_x_degrees = std::atan(tangent * width / 2) * 360 / std::numbers::pi;
  sensor.principal_point_offset_x = (window[0] + window[1]) / 2 / width;
  sensor.principal_point_offset_y = -(window[2] + window[3]) / 2 / height;
  const double radius = parameters.number("lensradius", 0, problems);
  const double focus = parameters.positive("focaldistance", 1e6, problems);
  if (!(radius >= 0)) problems.fail("\"lensradius\" must not be negative", parameters.where());
  if (radius > 0) sensor.projection = scene::Projection::kThinLens;
  sensor.aperture_radius = radius * scale;
  sensor.focus_distance = focus * scale;
}

void load_orthographic(Parameters& parameters, double scale, Context& context) {
  scene::Sensor& sensor = context.scene.sensor;
  Problems& problems = context.problems;
  const std::array<double, 4> window = read_screen_window(parameters, context);
  if (parameters.number("lensradius", 0, problems) != 0) {
    problems.unsupported("an orthographic camera with a lens is not supported", parameters.where());
  }
  parameters.ignore({"focaldistance"});
  const double half_width = (window[1] - window[0]) / 2 * scale;
  const Point center = {-(window[0] + window[1]) / 2 * scale, (window[2] + window[3]) / 2 * scale,
                        0};  // in our camera space
  sensor.projection = scene::Projection::kOrthographic;
  sensor.to_world = multiply(sensor.to_world,
                             multiply(translation(center), scaling({half_width, half_width, 1})));
}

void load_camera(RenderingOptions& options, Context& context) {
  scene::Sensor& sensor = context.scene.sensor;
  Parameters& parameters = options.camera.parameters;
  const std::string& type = options.camera.type;
  sensor.where = options.camera.where();
  load_shutter(parameters, context);
  const double scale = place_sensor(options, context);
  // pbrt's cameras see from their origin to infinity.
  sensor.near_clip = 1e-6 * scale;
  sensor.far_clip = 1e30;
  if (type == "orthographic") {
    load_orthographic(parameters, scale, context);
  } else {
    if (type != "perspective") {
      report_unknown_plugin("camera", options.camera, {"perspective", "orthographic"},
                            "a perspective camera takes its place", context.problems);
    }
    load_perspective(parameters, scale, context);
  }
  parameters.finish("camera \"" + type + "\"", context.problems);
}

// Every sampler is accepted: only the number of samples is of interest.
void load_sampler(Entity& entity, Context& context) {
  Parameters& parameters = entity.parameters;
  scene::IntegratorSettings& settings = context.scene.integrator;
  settings.sample_count = parameters.integer_in("pixelsamples", 16, 1, context.problems);
  const int across = parameters.integer_in("xsamples", 4, 1, context.problems);
  const int down = parameters.integer_in("ysamples", 4, 1, context.problems);
  if (entity.type == "stratified") {
    constexpr int64_t kMost = 1 << 30;
    settings.sample_count = static_cast<int>(std::min(int64_t{across} * down, kMost));
  }
  parameters.ignore({"seed", "jitter", "randomization"});
  parameters.finish("sampler \"" + entity.type + "\"", context.problems);
}

// pbrt counts bounces, the scene path edges: one more.
void load_integrator(Entity& entity, Context& context) {
  constexpr std::array<std::string_view, 9> kTypes = {"path",          "volpath",   "bdpt",
                                                      "mlt",           "sppm",      "simplepath",
                                                      "simplevolpath", "lightpath", "randomwalk"};
  Parameters& parameters = entity.parameters;
  scene::IntegratorSettings& settings = context.scene.integrator;
  if (std::find(kTypes.begin(), kTypes.end(), entity.type) == kTypes.end()) {
    context.problems.warn("integrator \"" + entity.type + "\" is not known; it is read as path",
                          entity.where());
  }
  settings.type = "path";
  if (entity.type == "bdpt") settings.type = "bdpt";
  constexpr int kMostBounces = 1 << 20;
  settings.max_depth =
      std::min(parameters.integer_in("maxdepth", 5, 0, context.problems), kMostBounces) + 1;
  // The rest steers how pbrt finds its image, not what it shows.
}

}  // namespace

void load_options(RenderingOptions& options, Context& context) {
  load_film(options.film, context);
  load_filter(options.filter, context);
  load_camera(options, context);
  load_sampler(options.sampler, context);
  load_integrator(options.integrator, context);
}

}  // namespace metrofarm::scene_file::pbrt
