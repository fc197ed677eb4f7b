#include "sensor/camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/sensor/mitsuba_cameras.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::sensor {
namespace {

using scene::Projection;
using test::Double3;
using test::lane_of;

void expect_near(Double3 a, Double3 b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

scene::Sensor sensor_of(const MitsubaRay& r) {
  scene::Sensor sensor;
  sensor.projection = r.projection;
  std::copy_n(r.to_world, 12, sensor.to_world.begin());
  sensor.fov_x_degrees = 55;
  sensor.near_clip = 0.25;
  sensor.far_clip = 900;
  sensor.principal_point_offset_x = r.principal_point_offset[0];
  sensor.principal_point_offset_y = r.principal_point_offset[1];
  sensor.aperture_radius = 0.4;
  sensor.focus_distance = 3.5;
  return sensor;
}

// At the film's own resolution and at others of the same shape.
TEST(Camera, RaysAreThoseOfMitsuba) {
  for (const MitsubaRay& r : kMitsubaRays) {
    SCOPED_TRACE("ray " + std::to_string(&r - kMitsubaRays));
    scene::Film film;
    film.width = r.film[0];
    film.height = r.film[1];
    film.crop = {r.crop[0], r.crop[1], r.crop[2], r.crop[3]};
    const int width = film.crop.width > 0 ? film.crop.width : film.width;
    const int height = film.crop.width > 0 ? film.crop.height : film.height;
    for (int factor : {1, 3}) {
      const int w = width * factor, h = height * factor;
      const Camera camera(sensor_of(r), film, w, h);
      const CameraRay ray =
          camera.ray(Float(r.position[0] * float(w)), Float(r.position[1] * float(h)),
                     {Float(r.lens[0]), Float(r.lens[1])});
      expect_near(lane_of(ray.origin, 0), {r.origin[0], r.origin[1], r.origin[2]}, 2e-6);
      expect_near(lane_of(ray.direction, 0), {r.direction[0], r.direction[1], r.direction[2]},
                  2e-6);
      EXPECT_NEAR(lane_value(ray.t_max, 0), r.t_max, 2e-5 * r.t_max);
    }
  }
}

scene::Sensor looking_along_z(Projection projection) {
  scene::Sensor sensor;
  sensor.projection = projection;
  sensor.fov_x_degrees = 60;
  sensor.aperture_radius = 0.5;
  sensor.focus_distance = 4;
  return sensor;
}

TEST(Camera, OnlyAnOpenLensNeedsItsSample) {
  scene::Sensor sensor = looking_along_z(Projection::kThinLens);
  EXPECT_TRUE(Camera(sensor, {}, 10, 10).has_lens());
  sensor.aperture_radius = 0;
  EXPECT_FALSE(Camera(sensor, {}, 10, 10).has_lens());
  EXPECT_FALSE(Camera(looking_along_z(Projection::kPerspective), {}, 10, 10).has_lens());
  EXPECT_FALSE(Camera(looking_along_z(Projection::kOrthographic), {}, 10, 10).has_lens());
}

// A closed lens is a pinhole.
TEST(Camera, ThinLensWithoutApertureIsPerspective) {
  scene::Sensor lens = looking_along_z(Projection::kThinLens);
  lens.aperture_radius = 0;
  const Camera a(lens, {}, 40, 30), b(looking_along_z(Projection::kPerspective), {}, 40, 30);
  test::UniformLanes random(1);
  const Float x = Float(40.F) * random.next(), y = Float(30.F) * random.next();
  const CameraRay ra = a.ray(x, y, random.pair()), rb = b.ray(x, y, random.pair());
  for (int lane = 0; lane < kLanes; ++lane) {
    expect_near(lane_of(ra.origin, lane), lane_of(rb.origin, lane), 0);
    expect_near(lane_of(ra.direction, lane), lane_of(rb.direction, lane), 0);
  }
}

// All rays of a raster position meet on the plane of focus.
TEST(Camera, LensRaysMeetInFocus) {
  const scene::Sensor sensor = looking_along_z(Projection::kThinLens);
  const Camera lens(sensor, {}, 40, 30);
  const Camera pinhole(looking_along_z(Projection::kPerspective), {}, 40, 30);
  test::UniformLanes random(1);
  for (int i = 0; i < 200; ++i) {
    const Float x = Float(40.F) * random.next(), y = Float(30.F) * random.next();
    const CameraRay a = lens.ray(x, y, random.pair()), b = pinhole.ray(x, y, {x, y});
    const auto at_focus = [](const CameraRay& ray) {
      return ray.origin + ray.direction * ((Float(4.F) - ray.origin.z) / ray.direction.z);
    };
    const Vec3 pa = at_focus(a), pb = at_focus(b);
    for (int lane = 0; lane < kLanes; ++lane)
      expect_near(lane_of(pa, lane), lane_of(pb, lane), 1e-5);
  }
}

// H0: points on the lens are uniform over its disk: 80,000 points in 8 x 8 cells of azimuth and
// squared radius, chi-square, rate 1e-6.
TEST(Camera, TheLensIsSampledUniformly) {
  scene::Sensor sensor = looking_along_z(Projection::kThinLens);
  sensor.near_clip = 0;
  const Camera camera(sensor, {}, 40, 30);
  test::UniformLanes random(2);
  std::vector<double> counts(64);
  constexpr int kPackets = 10000;
  for (int i = 0; i < kPackets; ++i) {
    const CameraRay ray = camera.ray(Float(20.F), Float(15.F), random.pair());
    for (int lane = 0; lane < kLanes; ++lane) {
      const Double3 p = lane_of(ray.origin, lane) * 2;
      EXPECT_LE(std::hypot(p.x, p.y), 1 + 1e-6);
      const double r2 = std::min(p.x * p.x + p.y * p.y, 0.999999);
      ++counts[size_t(r2 * 8) * 8 + size_t(std::min(test::turns(p.x, p.y), 0.999999) * 8)];
    }
  }
  double chi2 = 0;
  const double expected = kPackets * kLanes / 64.0;
  for (double c : counts) chi2 += (c - expected) * (c - expected) / expected;
  EXPECT_GT(test::chi_square_p(chi2, 63), 1e-6);
}

TEST(Camera, TheMiddleOfTheLensIsItsCenter) {
  scene::Sensor sensor = looking_along_z(Projection::kThinLens);
  sensor.near_clip = 0;
  const CameraRay ray =
      Camera(sensor, {}, 40, 30).ray(Float(3.F), Float(4.F), {Float(0.5F), Float(0.5F)});
  expect_near(lane_of(ray.origin, 0), {0, 0, 0}, 0);
}

// Another aspect ratio keeps the horizontal extent, the center and square pixels.
TEST(Camera, AnotherAspectRatioShowsMoreAboveAndBelow) {
  scene::Film film;
  film.width = 300;
  film.height = 200;
  for (const scene::CropWindow& crop : {scene::CropWindow{}, scene::CropWindow{30, 50, 120, 80}}) {
    film.crop = crop;
    const scene::Sensor sensor = looking_along_z(Projection::kPerspective);
    const Camera wide(sensor, film, 300, 200), square(sensor, film, 300, 300);
    const Float x(77.F);
    for (float from_middle : {-100.F, 0.F, 60.F}) {
      const CameraRay a = wide.ray(x, Float(100 + from_middle), {x, x});
      const CameraRay b = square.ray(x, Float(150 + from_middle), {x, x});
      expect_near(lane_of(a.direction, 0), lane_of(b.direction, 0), 1e-6);
    }
  }
}

// A point on a ray, shown to the camera, leads back to where the ray came from; and the raster area
// that a surface covers is what neighbouring rays enclose.
TEST(Camera, ConnectionsInvertRays) {
  for (const MitsubaRay& r : kMitsubaRays) {
    SCOPED_TRACE("ray " + std::to_string(&r - kMitsubaRays));
    scene::Film film;
    film.width = r.film[0];
    film.height = r.film[1];
    const Camera camera(sensor_of(r), film, film.width, film.height);
    const Float x(r.position[0] * float(film.width)), y(r.position[1] * float(film.height));
    const Vec2 lens{Float(r.lens[0]), Float(r.lens[1])};
    const CameraRay ray = camera.ray(x, y, lens);
    const Float t(7.5F);
    const CameraConnection c = camera.connect(ray.origin + ray.direction * t, lens);
    ASSERT_TRUE(all(c.valid));
    EXPECT_NEAR(lane_value(c.raster_x, 0), lane_value(x, 0), 2e-4F * float(film.width));
    EXPECT_NEAR(lane_value(c.raster_y, 0), lane_value(y, 0), 2e-4F * float(film.width));
    expect_near(lane_of(c.start, 0), lane_of(ray.origin, 0), 1e-4);
    expect_near(lane_of(c.direction, 0), lane_of(-ray.direction, 0), 1e-5);
    const float per_area = lane_value(camera.raster_per_area(ray, t), 0);
    EXPECT_NEAR(lane_value(c.raster_per_area, 0) / per_area, 1, 1e-4);
    // The area across the ray that a raster step each way spans, by differences of half a pixel.
    const auto at = [&](float dx, float dy) {
      const CameraRay near = camera.ray(x + Float(dx), y + Float(dy), lens);
      const Float to_plane = dot(ray.origin + ray.direction * t - near.origin, ray.direction) /
                             dot(near.direction, ray.direction);
      return near.origin + near.direction * to_plane;
    };
    const Vec3 across = cross(at(0.5F, 0) - at(-0.5F, 0), at(0, 0.5F) - at(0, -0.5F));
    EXPECT_NEAR(lane_value(length(across), 0) * per_area, 1, 5e-3);
  }
}

TEST(Camera, PointsBeyondTheClipPlanesAreNotConnected) {
  scene::Sensor sensor;
  sensor.near_clip = 1;
  sensor.far_clip = 10;
  const Camera camera(sensor, scene::Film{}, 64, 64);
  const Vec2 middle{Float(0.5F), Float(0.5F)};
  for (auto [depth, seen] :
       {std::pair{0.9F, false}, {1.1F, true}, {9.9F, true}, {10.1F, false}, {-2.F, false}})
    EXPECT_EQ(any(camera.connect(splat(0.1F, 0.1F, depth), middle).valid), seen) << depth;
}

}  // namespace
}  // namespace metrofarm::sensor
