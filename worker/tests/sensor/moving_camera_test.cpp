// A camera that moves against the same camera where it stands at that time.
#include <gtest/gtest.h>

#include "sensor/camera.h"
#include "tests/motion/motions.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::sensor {
namespace {

using metrofarm::test::lane_of;
using metrofarm::test::UniformLanes;
using motion::test::scaled;
using motion::test::translated;
using motion::test::turned;

scene::Sensor moving(scene::Projection projection) {
  scene::Sensor sensor;
  sensor.projection = projection;
  sensor.fov_x_degrees = 50;
  sensor.aperture_radius = 0.1;
  sensor.focus_distance = 3;
  // Orthographic cameras are as wide as their matrix.
  const scene::Matrix size =
      projection == scene::Projection::kOrthographic ? scaled(2, 2, 1) : scaled(1, 1, 1);
  sensor.motion.keys = {
      {0, motion::multiply(turned({0, 1, 0}, 10), size)},
      {1, motion::multiply(translated(1, 2, -1), motion::multiply(turned({1, 1, 0}, 60), size))}};
  return sensor;
}

// Steps follow the motion to a ten-thousandth of the surroundings, here of length 1.
constexpr double kStep = 1e-4;

TEST(MovingCamera, IsWhereItIsAtItsTime) {
  scene::Film film;
  film.width = 40;
  film.height = 30;
  for (auto projection : {scene::Projection::kPerspective, scene::Projection::kThinLens,
                          scene::Projection::kOrthographic}) {
    const scene::Sensor sensor = moving(projection);
    const Shutter shutter({.open = 0.1, .close = 0.9}, 30);
    const Camera camera(sensor, film, 40, 30, shutter, {});
    EXPECT_TRUE(camera.has_time());
    UniformLanes random(4);
    for (float time : {0.F, 0.2F, 0.77F, 1.F}) {
      scene::Sensor still = sensor;
      still.motion = {};
      still.to_world = motion::Track(sensor.motion).at(0.1 + 0.8 * double(time));
      const Camera there(still, film, 40, 30);
      EXPECT_FALSE(there.has_time());
      const Float x = random.next() * Float(40.F), y = random.next() * Float(30.F);
      const Vec2 lens = random.pair();
      const CameraRay a = camera.ray(x, y, lens, Float(time)), b = there.ray(x, y, lens);
      const Float t(2.5F);
      const Vec3 point = b.origin + b.direction * t;
      const CameraConnection c = camera.connect(point, lens, Float(time));
      const CameraConnection d = there.connect(point, lens);
      const Float importance = camera.raster_per_area(a, t) / there.raster_per_area(b, t);
      for (int lane = 0; lane < kLanes; ++lane) {
        EXPECT_NEAR(length(lane_of(a.origin - b.origin, lane)), 0, 2 * kStep);
        EXPECT_NEAR(length(lane_of(a.direction - b.direction, lane)), 0, 2 * kStep);
        EXPECT_NEAR(lane_value(importance, lane), 1, 10 * kStep);
        EXPECT_NEAR(lane_value(c.raster_x, lane), lane_value(x, lane), 100 * kStep);
        EXPECT_NEAR(lane_value(c.raster_y, lane), lane_value(y, lane), 100 * kStep);
        EXPECT_NEAR(lane_value(c.raster_per_area / d.raster_per_area, lane), 1, 10 * kStep);
        EXPECT_NEAR(length(lane_of(c.direction - d.direction, lane)), 0, 2 * kStep);
        EXPECT_NEAR(length(lane_of(c.start - d.start, lane)), 0, 2 * kStep);
      }
    }
  }
}

TEST(MovingCamera, HasNoTimeWhenTheShutterIsInstantOrTheKeysAreOver) {
  const scene::Sensor sensor = moving(scene::Projection::kPerspective);
  const scene::Film film;
  for (const ShutterSettings& s :
       {ShutterSettings{.open = 0.5, .close = 0.5}, ShutterSettings{.open = 1, .close = 5}}) {
    EXPECT_FALSE(Camera(sensor, film, 8, 8, Shutter(s, 8), {}).has_time());
    EXPECT_EQ(Camera(sensor, film, 8, 8, Shutter(s, 8), {.moves = true}).has_time(), true);
  }
}

}  // namespace
}  // namespace metrofarm::sensor
