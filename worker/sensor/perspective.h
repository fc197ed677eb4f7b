// The pinhole camera.
#pragma once

#include "math/vec.h"
#include "scene/description.h"

namespace metrofarm::sensor {

struct CameraRay {
  Vec3 origin;
  Vec3 direction;  // unit
};

class PerspectiveCamera {
 public:
  // width, height: the film's size in pixels.
  PerspectiveCamera(const scene::PerspectiveSensor& sensor, int width, int height);

  // The ray through raster position (x, y) in pixels from the film's upper left corner; positions
  // outside the film continue its plane.
  CameraRay ray(Float x, Float y) const;

 private:
  // direction = corner + x * step_x + y * step_y, before normalization
  float origin_[3];
  float corner_[3];
  float step_x_[3];
  float step_y_[3];
};

}  // namespace metrofarm::sensor
