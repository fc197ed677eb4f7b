// The cameras: pinhole, thin lens, orthographic; they may move while their shutter is open.
#pragma once

#include "math/vec.h"
#include "math/warp.h"
#include "motion/pose_table.h"
#include "scene/description.h"
#include "sensor/shutter.h"

namespace metrofarm::sensor {

// Starts on the near clip plane: what lies before it isn't seen.
struct CameraRay {
  Vec3 origin;
  Vec3 direction;  // unit
  Float t_max;     // distance to the far clip plane
  Float lead;      // distance from the lens (orthographic: the image plane) to the origin
  Float time;
};

// A point of the scene as the camera sees it.
struct CameraConnection {
  Vec3 start;      // on the near clip plane, where the ray to the point would start
  Vec3 direction;  // unit, from the point towards the camera
  Float raster_x, raster_y;
  Float raster_per_area;  // see Camera::raster_per_area()
  Mask valid;             // between the clip planes
};

class Camera {
 public:
  // width, height: size in pixels of the image to be rendered, which is the film's crop window (the
  // whole film if it has none) at a resolution of its own. Pixels are square and the horizontal
  // extent stays: another aspect ratio shows more or less above and below.
  //
  // surroundings: what the camera looks at.
  struct Surroundings {
    bool moves = false;  // while the shutter is open
    double radius = 1;
  };
  Camera(const scene::Sensor& sensor, const scene::Film& film, int width, int height,
         const Shutter& shutter, const Surroundings& surroundings);
  // With an instant shutter.
  Camera(const scene::Sensor& sensor, const scene::Film& film, int width, int height);

  // True if rays depend on the lens sample.
  bool has_lens() const { return has_lens_; }
  // True if anything depends on the time: the camera moves, or what it looks at.
  bool has_time() const { return has_time_; }
  const Shutter& shutter() const { return shutter_; }

  // The ray through raster position (x, y) in pixels from the image's upper left corner; positions
  // outside the image continue its plane. lens: uniform over the unit square. time: in [0, 1], from
  // the begin to the end of the shutter's interval.
  CameraRay ray(Float x, Float y, Vec2 lens, Float time = Float(0.F)) const;

  // Raster area, in square pixels, that a surface of unit area across the ray covers where the ray
  // has come the distance t: the importance that the camera emits towards it (Veach 1997, section
  // 8.2.1), in the units in which every pixel has size 1.
  Float raster_per_area(const CameraRay& ray, Float t) const;

  // The ray that ends at `point`, from the same place on the lens as ray(..., lens, time).
  CameraConnection connect(const Vec3& point, Vec2 lens, Float time = Float(0.F)) const;

 private:
  struct Axis {
    float v[3] = {};
  };
  static Vec3 splat_of(const Axis& a) { return splat(a.v[0], a.v[1], a.v[2]); }
  void invert_plane();
  Vec3 aperture(Vec2 lens) const;
  // Raster area per solid angle around a step whose length in the world is `stretch`, or
  // orthographic: per area.
  Float density(const Vec3& step, Float stretch) const;
  bool moves() const { return poses_.count() > 0; }
  motion::LanePose pose_at(Float time) const { return poses_.at(Int(0), time, all_lanes()); }
  scene::Matrix stand(const scene::Sensor& sensor, double radius);

  // All in world space, or if the camera moves in the space that does. A raster position lies at
  // corner + x * step_x + y * step_y on the image plane: of perspective cameras the plane z = 1 of
  // their space seen from the origin, of orthographic ones the plane z = 0 itself.
  Axis origin_, forward_, corner_, step_x_, step_y_;
  Axis lens_x_, lens_y_;  // radii of the aperture
  // Rows that take a vector apart into depth, x and y: multiples of corner_ (orthographic:
  // forward_), step_x_ and step_y_.
  Axis to_depth_, to_x_, to_y_;
  Axis pixel_normal_;  // step_x_ cross step_y_
  float inverse_focus_ = 0;
  float near_ = 0, far_ = 0;
  bool orthographic_ = false;
  bool has_lens_ = false;
  bool has_time_ = false;
  Shutter shutter_;
  motion::PoseTable poses_;  // of the camera, if it moves
};

}  // namespace metrofarm::sensor
