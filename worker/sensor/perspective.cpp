#include "sensor/perspective.h"

#include <cmath>
#include <numbers>

namespace metrofarm::sensor {

PerspectiveCamera::PerspectiveCamera(const scene::PerspectiveSensor& sensor, int width,
                                     int height) {
  const scene::Matrix& m = sensor.to_world;
  const double half_width = std::tan(sensor.fov_x_degrees * std::numbers::pi / 360);
  const double per_pixel = 2 * half_width / width;
  // In camera space +x points to the left of the image and +y up.
  const double left = half_width * (1 - 2 * sensor.principal_point_offset_x);
  const double top = per_pixel * height * (0.5 - sensor.principal_point_offset_y);
  for (int row = 0; row < 3; ++row) {
    const double* axis = &m[size_t{4} * row];
    // The matrix may scale; only directions matter, and normalization undoes a uniform factor.
    corner_[row] = static_cast<float>(axis[0] * left + axis[1] * top + axis[2]);
    step_x_[row] = static_cast<float>(-axis[0] * per_pixel);
    step_y_[row] = static_cast<float>(-axis[1] * per_pixel);
    origin_[row] = static_cast<float>(axis[3]);
  }
}

CameraRay PerspectiveCamera::ray(Float x, Float y) const {
  const Vec3 direction{Float(corner_[0]) + x * Float(step_x_[0]) + y * Float(step_y_[0]),
                       Float(corner_[1]) + x * Float(step_x_[1]) + y * Float(step_y_[1]),
                       Float(corner_[2]) + x * Float(step_x_[2]) + y * Float(step_y_[2])};
  return {splat(origin_[0], origin_[1], origin_[2]), normalize(direction)};
}

}  // namespace metrofarm::sensor
