// The cameras: pinhole, thin lens, orthographic.
#pragma once

#include "math/vec.h"
#include "math/warp.h"
#include "scene/description.h"

namespace metrofarm::sensor {

// Starts on the near clip plane: what lies before it isn't seen.
struct CameraRay {
  Vec3 origin;
  Vec3 direction;  // unit
  Float t_max;     // distance to the far clip plane
};

class Camera {
 public:
  // width, height: size in pixels of the image to be rendered, which is the film's crop window (the
  // whole film if it has none) at a resolution of its own. Pixels are square and the horizontal
  // extent stays: another aspect ratio shows more or less above and below.
  Camera(const scene::Sensor& sensor, const scene::Film& film, int width, int height);

  // True if rays depend on the lens sample.
  bool has_lens() const { return has_lens_; }

  // The ray through raster position (x, y) in pixels from the image's upper left corner; positions
  // outside the image continue its plane. lens: uniform over the unit square.
  CameraRay ray(Float x, Float y, Vec2 lens) const;

 private:
  struct Axis {
    float v[3] = {};
  };
  static Vec3 splat_of(const Axis& a) { return splat(a.v[0], a.v[1], a.v[2]); }

  // All in world space. A raster position lies at corner + x * step_x + y * step_y on the image
  // plane: of perspective cameras the plane z = 1 of their space seen from the origin, of
  // orthographic ones the plane z = 0 itself.
  Axis origin_, forward_, corner_, step_x_, step_y_;
  Axis lens_x_, lens_y_;  // radii of the aperture
  float inverse_focus_ = 0;
  float near_ = 0, far_ = 0;
  bool orthographic_ = false;
  bool has_lens_ = false;
};

}  // namespace metrofarm::sensor
