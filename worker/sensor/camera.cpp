#include "sensor/camera.h"

#include <array>
#include <cmath>
#include <numbers>

namespace metrofarm::sensor {
namespace {

using scene::Film;
using scene::Projection;
using scene::Sensor;

// The image in camera space, on the plane of the image (see Camera): its center and the extent of
// one pixel of the rendered image.
struct Window {
  double center_x, center_y, per_pixel;
};

Window window_of(const Sensor& sensor, const Film& film, int width, int height) {
  const bool cropped = film.crop.width > 0;
  // Without a crop window the film takes the aspect ratio of the rendered image.
  const double film_width = cropped ? film.width : width;
  const double film_height = cropped ? film.height : height;
  const scene::CropWindow crop = cropped ? film.crop : scene::CropWindow{0, 0, width, height};
  const double half_width = sensor.projection == Projection::kOrthographic
                                ? 1
                                : std::tan(sensor.fov_x_degrees * std::numbers::pi / 360);
  const double half_height = half_width * film_height / film_width;
  const double at_x = (crop.x + 0.5 * crop.width) / film_width + sensor.principal_point_offset_x;
  const double at_y = (crop.y + 0.5 * crop.height) / film_height + sensor.principal_point_offset_y;
  // In camera space +x points to the left of the image and +y up.
  return {half_width * (1 - 2 * at_x), half_height * (1 - 2 * at_y),
          2 * half_width / film_width * crop.width / width};
}

// Shirley and Chiu 1997, "A Low Distortion Map Between Disk and Square". pdf_area = 1 / pi.
Vec2 square_to_concentric_disk(Vec2 u) {
  const Float a = Float(2.F) * u.x - Float(1.F), b = Float(2.F) * u.y - Float(1.F);
  const Mask wide = xsimd::abs(a) > xsimd::abs(b);
  const Float radius = select(wide, a, b), other = select(wide, b, a);
  const Mask center = radius == Float(0.F);
  const Float eighth = other / select(center, Float(1.F), radius) * Float(0.125F);
  const SinCos s = sincos_turn(select(wide, eighth, Float(0.25F) - eighth));
  return {radius * s.cos, radius * s.sin};
}

}  // namespace

Camera::Camera(const Sensor& sensor, const Film& film, int width, int height)
    : Camera(sensor, film, width, height, Shutter({.open = sensor.shutter_open}, height), {}) {}

Camera::Camera(const Sensor& sensor, const Film& film, int width, int height,
               const Shutter& shutter, const Surroundings& surroundings)
    : near_(static_cast<float>(sensor.near_clip)),
      far_(static_cast<float>(sensor.far_clip)),
      orthographic_(sensor.projection == Projection::kOrthographic),
      has_lens_(sensor.projection == Projection::kThinLens && sensor.aperture_radius > 0),
      shutter_(shutter),
      poses_(shutter.interval()) {
  const scene::Matrix to_world = stand(sensor, surroundings.radius);
  has_time_ = moves() || surroundings.moves;
  const Window w = window_of(sensor, film, width, height);
  const double left = w.center_x + 0.5 * w.per_pixel * width;
  const double top = w.center_y + 0.5 * w.per_pixel * height;
  const double radius = has_lens_ ? sensor.aperture_radius : 0;
  if (has_lens_) inverse_focus_ = static_cast<float>(1 / sensor.focus_distance);
  for (int row = 0; row < 3; ++row) {
    const double* axis = &to_world[size_t{4} * row];
    const auto set = [&](Axis& a, double value) { a.v[row] = static_cast<float>(value); };
    set(origin_, axis[3]);
    set(forward_, axis[2]);
    set(corner_, axis[0] * left + axis[1] * top + (orthographic_ ? axis[3] : axis[2]));
    set(step_x_, -axis[0] * w.per_pixel);
    set(step_y_, -axis[1] * w.per_pixel);
    set(lens_x_, axis[0] * radius);
    set(lens_y_, axis[1] * radius);
  }
  invert_plane();
}

// The matrix of the axes; if the camera moves its motion comes on top.
scene::Matrix Camera::stand(const Sensor& sensor, double radius) {
  if (sensor.motion.empty()) return sensor.to_world;
  const motion::Track track(sensor.motion);
  if (!track.moves_during(poses_.interval()))
    return motion::multiply(track.at(poses_.interval().begin), sensor.to_world);
  poses_.add_viewpoint(track, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, radius);
  return sensor.to_world;
}

// Cramer's rule: the rows are cross products of the columns over their determinant.
void Camera::invert_plane() {
  const Axis& first = orthographic_ ? forward_ : corner_;
  const auto cross_of = [](const Axis& a, const Axis& b) {
    std::array<double, 3> c{};
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      c[k] = double(a.v[i]) * b.v[j] - double(a.v[j]) * b.v[i];
    }
    return c;
  };
  const auto normal = cross_of(step_x_, step_y_);
  double determinant = 0;
  for (int k = 0; k < 3; ++k) determinant += normal[k] * first.v[k];
  const auto across_x = cross_of(step_y_, first), across_y = cross_of(first, step_x_);
  for (int k = 0; k < 3; ++k) {
    pixel_normal_.v[k] = static_cast<float>(normal[k]);
    to_depth_.v[k] = static_cast<float>(normal[k] / determinant);
    to_x_.v[k] = static_cast<float>(across_x[k] / determinant);
    to_y_.v[k] = static_cast<float>(across_y[k] / determinant);
  }
}

Vec3 Camera::aperture(Vec2 lens) const {
  if (!has_lens_) return splat(0.F);
  const Vec2 d = square_to_concentric_disk(lens);
  return d.x * splat_of(lens_x_) + d.y * splat_of(lens_y_);
}

CameraRay Camera::ray(Float x, Float y, Vec2 lens, Float time) const {
  const Vec3 on_plane = splat_of(corner_) + x * splat_of(step_x_) + y * splat_of(step_y_);
  // The step along the ray per unit of depth in camera space, and where depth is 0.
  Vec3 step = orthographic_ ? splat_of(forward_) : on_plane;
  Vec3 start = orthographic_ ? on_plane : splat_of(origin_);
  if (has_lens_) {
    const Vec3 on_lens = aperture(lens);
    start = start + on_lens;
    step = step - on_lens * Float(inverse_focus_);
  }
  if (moves()) {
    const motion::LanePose pose = pose_at(time);
    start = pose.point(start);
    step = pose.vector(step);
  }
  const Float stretch = length(step);
  // As in Mitsuba, the far clip plane of an orthographic camera doesn't scale with its matrix.
  const Float depth(far_ - near_);
  return {start + step * Float(near_), step * (Float(1.F) / stretch),
          orthographic_ ? depth : depth * stretch, Float(near_) * stretch, time};
}

// A raster step moves `step` by step_x_ or step_y_, which turns it by what is across it.
Float Camera::density(const Vec3& step, Float stretch) const {
  const Float pixel = xsimd::abs(dot(step, splat_of(pixel_normal_)));
  return orthographic_ ? stretch / pixel : sqr(stretch) * stretch / pixel;
}

Float Camera::raster_per_area(const CameraRay& ray, Float t) const {
  Vec3 direction = ray.direction;
  Float volume(1.F);  // of a unit cube of the camera's space in the world
  if (moves()) {
    const motion::LanePose pose = pose_at(ray.time);
    direction = motion::inverse_of(pose).vector(direction);
    volume = xsimd::abs(pose.determinant());
  }
  // density() takes a step that ends on the plane of depth 1, where pixel_normal_ was measured.
  if (orthographic_) return density(direction, length(ray.direction)) / volume;
  const Float depth = dot(direction, splat_of(to_depth_));
  const Vec3 step = direction / depth;
  if (!moves()) return density(step, length(step)) / sqr(ray.lead + t);
  return density(step, Float(1.F) / xsimd::abs(depth)) / (volume * sqr(ray.lead + t));
}

CameraConnection Camera::connect(const Vec3& point, Vec2 lens, Float time) const {
  CameraConnection c;
  motion::LanePose pose;
  Vec3 place = point;
  if (moves()) {
    pose = pose_at(time);
    place = motion::inverse_of(pose).vector(point - pose.offset);
  }
  const auto to_world = [&](const Vec3& v) { return moves() ? pose.vector(v) : v; };
  const Vec3 from = place - (orthographic_ ? splat_of(corner_) : splat_of(origin_));
  const Float depth = dot(from, splat_of(to_depth_));
  const Vec3 on_lens = aperture(lens);
  const Vec3 along = orthographic_ ? depth * splat_of(forward_) : from - on_lens;
  const Vec3 step = orthographic_ ? splat_of(forward_) : along / depth;
  const Vec3 on_plane = orthographic_ ? from : step + on_lens * Float(inverse_focus_);
  c.raster_x = dot(on_plane, splat_of(to_x_));
  c.raster_y = dot(on_plane, splat_of(to_y_));
  const Vec3 world_step = to_world(step);
  const Float stretch = length(world_step);
  const Float beyond = depth - Float(near_);
  c.start = point - world_step * beyond;
  const Float reach = orthographic_ ? beyond * stretch : beyond;
  c.valid = (beyond > Float(0.F)) & (reach <= Float(far_ - near_));
  c.direction = -normalize(world_step);
  c.raster_per_area = density(step, stretch);
  if (!orthographic_) c.raster_per_area = c.raster_per_area / length_squared(to_world(along));
  if (moves()) c.raster_per_area = c.raster_per_area / xsimd::abs(pose.determinant());
  return c;
}

}  // namespace metrofarm::sensor
