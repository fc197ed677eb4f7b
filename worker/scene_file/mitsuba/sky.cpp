#include "scene_file/mitsuba/sky.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

#include "scene_file/mitsuba/colours.h"
#include "scene_file/mitsuba/sky_model.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kHeight = 512;
constexpr int kWidth = 2 * kHeight;

// +z of the model is +y of environment images.
constexpr Matrix kModelToImage = {1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1};

struct SkySettings {
  Matrix to_world = kIdentity;  // of the image
  Point to_sun = {0, 0, 1};     // in the model's space, unit length
  double turbidity = 3;
  scene::Rgb albedo = {0, 0, 0};
  double sky_scale = 1;
  double sun_scale = 1;
  double sun_half_angle = 0;  // radians
  double stretch = 1;         // 0.6: the sky reaches this much below the horizon
};

DateAndPlace read_date_and_place(Properties& properties) {
  DateAndPlace when;
  when.year = properties.integer_in("year", when.year, -4000, 10000);
  when.month = properties.integer_in("month", when.month, 1, 12);
  when.day = properties.integer_in("day", when.day, 1, 31);
  when.hour = properties.number_in("hour", when.hour, 0, 24);
  when.minute = properties.number_in("minute", when.minute, 0, 60);
  when.second = properties.number_in("second", when.second, 0, 60);
  when.latitude_degrees = properties.number_in("latitude", when.latitude_degrees, -90, 90);
  when.longitude_degrees = properties.number_in("longitude", when.longitude_degrees, -180, 180);
  when.timezone = properties.number_in("timezone", when.timezone, -14, 14);
  return when;
}

// The direction to the sun in the space of the emitter, whose up axis is `y_up` ? y : z.
Point read_sun(Properties& properties, bool y_up) {
  if (properties.has("sun_direction")) {
    const Point world = properties.point("sun_direction", {0, 0, 1});
    if (length(world) == 0) {
      properties.problems().fail("sun_direction must not be (0, 0, 0)",
                                 properties.find("sun_direction")->where);
    }
    const Matrix to_world = properties.transform("to_world");
    Point local;
    for (int axis = 0; axis < 3; ++axis)
      local[axis] = dot(normalized(column(to_world, axis)), world);
    return normalized(local);
  }
  const SunPosition sun = sun_position(read_date_and_place(properties));
  const double across = std::sin(sun.zenith_angle);
  const double north = across * std::cos(sun.azimuth);
  const double east = across * std::sin(sun.azimuth);
  const double up = std::cos(sun.zenith_angle);
  // Where the two generations of Mitsuba put north.
  return y_up ? Point{east, up, -north} : Point{-north, -east, up};
}

// Files of 0.6 have +y up, unless they use what only Mitsuba 3 knows.
bool has_y_up(Properties& properties) {
  return properties.element().legacy && !properties.has("sun_aperture");
}

void read_sun_size(Properties& properties, bool y_up, SkySettings& sky) {
  double aperture = kSunApertureDegrees;
  if (y_up) {
    aperture *= properties.number_in("sun_radius_scale", 1, 0.01, 300);
  } else {
    aperture = properties.number_in("sun_aperture", aperture, 0.01, 179.9);
  }
  sky.sun_half_angle = aperture / 2 * (kPi / 180);
}

SkySettings read_settings(Properties& properties, Context& context) {
  const std::string& type = properties.element().get("type");
  const bool y_up = has_y_up(properties);
  SkySettings sky;
  sky.to_world = properties.transform("to_world");
  sky.to_sun = read_sun(properties, y_up);
  if (y_up) {
    sky.to_sun = {sky.to_sun[0], -sky.to_sun[2], sky.to_sun[1]};
  } else {
    // The image's space to the emitter's: the inverse (transpose) of the map between them.
    Matrix inverse = kIdentity;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) inverse[4 * i + j] = kModelToImage[4 * j + i];
    }
    sky.to_world = multiply(sky.to_world, inverse);
  }
  sky.turbidity = properties.number_in("turbidity", 3, 1, 10);
  const float albedo = y_up ? 0.2F : 0.3F;
  sky.albedo =
      read_colour(properties, "albedo", {albedo, albedo, albedo}, ColourUse::kReflectance, context);
  const double scale = properties.number_in("scale", 1, 0, 1e30);
  sky.sky_scale = type == "sun" ? 0 : scale * properties.number_in("sky_scale", 1, 0, 1e30);
  sky.sun_scale = type == "sky" ? 0 : scale * properties.number_in("sun_scale", 1, 0, 1e30);
  sky.stretch = properties.number_in("stretch", 1, 0.5, 2);
  read_sun_size(properties, y_up, sky);
  // How it is sampled and stored.
  properties.ignore({"resolution", "extend", "complex_sun", "cache"});
  return sky;
}

// Between the rows of an environment image, whose first and last are the poles.
constexpr double kRowAngle = kPi / (kHeight - 1);

// Direction in the model's space of a pixel's centre.
Point direction_at(int column, double row) {
  const double theta = row * kRowAngle;
  const double phi = (column + 0.5) / kWidth * 2 * kPi;
  const double across = std::sin(theta);
  return {across * std::sin(phi), across * std::cos(phi), std::cos(theta)};
}

// The pixel nearest to a direction.
std::pair<int, int> pixel_of(const Point& direction) {
  double turn = std::atan2(direction[0], direction[1]) / (2 * kPi);
  if (turn < 0) turn += 1;
  const double theta = std::acos(std::clamp(direction[2], -1.0, 1.0));
  return {std::min(static_cast<int>(turn * kWidth), kWidth - 1),
          std::min(static_cast<int>(std::lround(theta / kRowAngle)), kHeight - 1)};
}

// Integral over the sphere of the part that a pixel has in the image: the radiance falls linearly
// to the neighbours in angle, so this is that of a pyramid, times the sine of the polar angle.
double pixel_solid_angle(int row) {
  const double across = 2 * kPi / kWidth;
  if (row == 0 || row == kHeight - 1) return (1 - std::sin(kRowAngle) / kRowAngle) * across;
  return std::sin(row * kRowAngle) * 2 * (1 - std::cos(kRowAngle)) / kRowAngle * across;
}

void add_sky(const SkyModel& model, const SkySettings& sky, std::vector<float>& pixels) {
  for (int row = 0; row < kHeight; ++row) {
    const double stretched = row / sky.stretch;
    if (stretched * kRowAngle > kPi / 2) return;
    for (int column = 0; column < kWidth; ++column) {
      const auto radiance = model.sky_radiance(direction_at(column, stretched));
      for (int c = 0; c < 3; ++c) {
        pixels[3 * (size_t{1} * row * kWidth + column) + c] +=
            static_cast<float>(sky.sky_scale * radiance[c]);
      }
    }
  }
}

// How many of kSunPoints, which are even on the sun's disk, are nearest to which pixel: (row,
// column). Those below the horizon are left out.
constexpr int kSunPoints = 200000;

std::map<std::pair<int, int>, int> cover_sun(const SkySettings& sky) {
  const Point x = any_perpendicular(sky.to_sun);
  const Point y = cross(sky.to_sun, x);
  std::map<std::pair<int, int>, int> counts;
  // A spiral of equal solid angles (Vogel 1979).
  for (int i = 0; i < kSunPoints; ++i) {
    const double fall = (i + 0.5) / kSunPoints * (1 - std::cos(sky.sun_half_angle));
    const double cosine = 1 - fall;
    const double sine = std::sqrt(fall * (2 - fall));
    const double phi = i * kPi * (3 - std::sqrt(5.0));
    Point direction;
    for (int axis = 0; axis < 3; ++axis) {
      direction[axis] =
          cosine * sky.to_sun[axis] + sine * (std::cos(phi) * x[axis] + std::sin(phi) * y[axis]);
    }
    if (direction[2] < 0) continue;
    const auto [column, row] = pixel_of(direction);
    ++counts[{row, column}];
  }
  return counts;
}

// Spreads the sun's light over the pixels that its disk covers, so that the integral of its
// radiance over all directions is exact however small it is. It is that of its natural size, as in
// Mitsuba.
void add_sun(const SkyModel& model, const SkySettings& sky, std::vector<float>& pixels) {
  const auto solid_angle = [](double half_angle) { return 2 * kPi * (1 - std::cos(half_angle)); };
  const double natural = solid_angle(kSunApertureDegrees / 2 * (kPi / 180));
  const std::array<double, 3> radiance = model.sun_radiance();
  for (const auto& [pixel, count] : cover_sun(sky)) {
    const auto [row, column] = pixel;
    const double share = static_cast<double>(count) / kSunPoints;
    const double weight = sky.sun_scale * natural * share / pixel_solid_angle(row);
    for (int c = 0; c < 3; ++c) {
      pixels[3 * (size_t{1} * row * kWidth + column) + c] +=
          static_cast<float>(weight * radiance[c]);
    }
  }
}

}  // namespace

decltype(scene::Emitter::model) load_sky(Properties& properties, Context& context) {
  const SkySettings sky = read_settings(properties, context);
  scene::EnvironmentEmitter emitter;
  emitter.to_world = sky.to_world;
  if (context.problems.failed()) return emitter;
  if (flattens(sky.to_world)) {
    context.problems.fail("the sky's to_world must not flatten space",
                          properties.find("to_world")->where);
    return emitter;
  }
  if (sky.to_sun[2] < 0) {
    context.problems.fail(
        "the sun is below the horizon (the sky's up axis is y in files older than version 2, "
        "else z, turned by to_world)",
        properties.element().where);
    return emitter;
  }
  std::vector<float> pixels(size_t{3} * kWidth * kHeight, 0.0F);
  const SkyModel model(sky.turbidity, sky.albedo, sky.to_sun);
  if (sky.sky_scale > 0) add_sky(model, sky, pixels);
  if (sky.sun_scale > 0) add_sun(model, sky, pixels);
  context.problems.warn(properties.element().describe() + " becomes an environment image of " +
                            std::to_string(kWidth) + " x " + std::to_string(kHeight) +
                            " pixels: the sun's disk is uniform",
                        properties.element().where);
  emitter.image = static_cast<scene::Index>(context.scene.images.size());
  context.scene.images.push_back({kWidth, kHeight, 3, std::move(pixels), false});
  if (const auto error = context.files.memory().take(context.scene.images.back())) {
    context.problems.fail(error->message, properties.element().where);
  }
  return emitter;
}

}  // namespace metrofarm::scene_file::mitsuba
