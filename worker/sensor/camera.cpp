#include "sensor/camera.h"

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
    : near_(static_cast<float>(sensor.near_clip)),
      far_(static_cast<float>(sensor.far_clip)),
      orthographic_(sensor.projection == Projection::kOrthographic),
      has_lens_(sensor.projection == Projection::kThinLens && sensor.aperture_radius > 0) {
  const Window w = window_of(sensor, film, width, height);
  const double left = w.center_x + 0.5 * w.per_pixel * width;
  const double top = w.center_y + 0.5 * w.per_pixel * height;
  const double radius = has_lens_ ? sensor.aperture_radius : 0;
  if (has_lens_) inverse_focus_ = static_cast<float>(1 / sensor.focus_distance);
  for (int row = 0; row < 3; ++row) {
    const double* axis = &sensor.to_world[size_t{4} * row];
    const auto set = [&](Axis& a, double value) { a.v[row] = static_cast<float>(value); };
    set(origin_, axis[3]);
    set(forward_, axis[2]);
    set(corner_, axis[0] * left + axis[1] * top + (orthographic_ ? axis[3] : axis[2]));
    set(step_x_, -axis[0] * w.per_pixel);
    set(step_y_, -axis[1] * w.per_pixel);
    set(lens_x_, axis[0] * radius);
    set(lens_y_, axis[1] * radius);
  }
}

CameraRay Camera::ray(Float x, Float y, Vec2 lens) const {
  const Vec3 on_plane = splat_of(corner_) + x * splat_of(step_x_) + y * splat_of(step_y_);
  // The step along the ray per unit of depth in camera space, and where depth is 0.
  Vec3 step = orthographic_ ? splat_of(forward_) : on_plane;
  Vec3 start = orthographic_ ? on_plane : splat_of(origin_);
  if (has_lens_) {
    const Vec2 d = square_to_concentric_disk(lens);
    const Vec3 aperture = d.x * splat_of(lens_x_) + d.y * splat_of(lens_y_);
    start = start + aperture;
    step = step - aperture * Float(inverse_focus_);
  }
  const Float stretch = length(step);
  // As in Mitsuba, the far clip plane of an orthographic camera doesn't scale with its matrix.
  const Float depth(far_ - near_);
  return {start + step * Float(near_), step * (Float(1.F) / stretch),
          orthographic_ ? depth : depth * stretch};
}

}  // namespace metrofarm::sensor
