// The cameras: pinhole, thin lens, orthographic.
#pragma once

#include "math/vec.h"
#include "scene/description.h"

namespace metrofarm::sensor {

struct CameraRay {
  Vec3 origin;
  Vec3 direction;  // unit
};

class Camera {
 public:
  // width, height: size in pixels of the image to be rendered, which is the film's crop window (the
  // whole film if it has none) at a resolution of its own.
  Camera(const scene::Sensor& sensor, const scene::Film& film, int width, int height);

  // True if rays depend on the lens sample.
  bool has_lens() const;

  // The ray through raster position (x, y) in pixels from the image's upper left corner; positions
  // outside the image continue its plane. lens: uniform over the unit square.
  CameraRay ray(Float x, Float y, Vec2 lens) const;
};

}  // namespace metrofarm::sensor
