#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "emitter/light_table.h"
#include "tests/emitter/lights.h"
#include "tests/support/lane_tools.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace metrofarm::emitter {
namespace {

using test::lane_of;
using test::Lights;
using test::SceneBuilder;

constexpr double kPiDouble = std::numbers::pi;

// H0: without a receiver lights are chosen in proportion to their power. 80,000 choices of five
// lights (the second is two triangles), rate 1e-6.
TEST(LightTable, ByPowerIsProportionalToPower) {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(scene::Sphere{{10, 0, 0}, 0.5}, grey, b.area_light(2));
  b.shape(test::quad({-10, -1, -1}, {0, 2, 0}, {0, 0, 2}), grey, b.area_light(3));
  b.shape(test::disk({0, 0, 10}, 1.5, true), grey, b.area_light(0.5F));
  b.emitter(scene::PointEmitter{{0, 10, 0}, {1.5F, 1.5F, 1.5F}});
  b.emitter(scene::DirectionalEmitter{{0, -1, 0}, {0.25F, 0.25F, 0.25F}});
  const Lights lights(b);
  // The scene's box is -10 to 10.5, -1.5 to 1.5 (the disk's), -1 to 10 wide.
  const double radius2 = (20.5 * 20.5 + 3 * 3 + 11 * 11) / 4;
  const double power[6] = {kPiDouble * 2 * kPiDouble, kPiDouble * 3 * 2,
                           kPiDouble * 3 * 2,         kPiDouble * 0.5 * 2.25 * kPiDouble,
                           4 * kPiDouble * 1.5,       kPiDouble * radius2 * 0.25};
  double total = 0;
  for (double p : power) total += p;
  std::vector<double> observed(6), expected(6);
  for (int i = 0; i < 6; ++i) expected[i] = 80000 * power[i] / total;
  test::UniformLanes random(1);
  for (int i = 0; i < 10000; ++i) {
    const LightChoice c = lights.table.by_power().choose(random.next(), all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      const uint32_t light = lane_word(as_uint(c.light), lane);
      ++observed[light];
      EXPECT_NEAR(lane_value(c.probability, lane), power[light] / total, 1e-5);
    }
  }
  EXPECT_TRUE(test::follows(observed, expected, 1e-6));
}

TEST(LightTable, APointLightFallsOffWithTheSquareOfTheDistance) {
  SceneBuilder b;
  b.emitter(scene::PointEmitter{{1, 2, 3}, {4, 5, 6}});
  const Lights lights(b);
  for (float distance : {0.01F, 1.F, 700.F}) {
    const LightSample s =
        lights.sample(splat(1 + distance, 2, 3), Float(0.5F), {Float(0.5F), Float(0.5F)});
    EXPECT_TRUE(all(s.valid & s.delta));
    EXPECT_NEAR(lane_value(s.value.y, 0) * distance * distance / 5, 1, 1e-4);
    EXPECT_NEAR(lane_value(s.distance, 0) / distance, 1, 1e-4);
    EXPECT_NEAR(lane_value(s.direction.x, 0), -1, 1e-6);
  }
}

TEST(LightTable, OneSideOfAnAreaLightIsDark) {
  for (bool flip : {false, true}) {
    SceneBuilder b;
    b.shape(test::quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}), b.diffuse(0.5F), b.area_light(1), flip);
    const Lights lights(b);
    const Vec2 middle{Float(0.5F), Float(0.5F)};
    const LightSample above = lights.sample(splat(0, 0, 1), Float(0.5F), middle);
    const LightSample below = lights.sample(splat(0, 0, -1), Float(0.5F), middle);
    EXPECT_EQ(all(above.valid), !flip);
    EXPECT_EQ(all(below.valid), flip);
    EXPECT_EQ(lane_value(above.value.x, 0) > 0, !flip);
  }
}

// Light arriving at the center of a hemisphere-filling quad is its solid angle: E[value] over
// samples is the integral of radiance. H0: mean = radiance x solid angle; 80,000 samples, rate
// 1e-6.
TEST(LightTable, ValuesIntegrateToTheSolidAngle) {
  SceneBuilder b;
  b.shape(test::quad({-1, -1, -1}, {2, 0, 0}, {0, 2, 0}), b.diffuse(0.5F), b.area_light(3));
  const Lights lights(b);
  test::UniformLanes random(2);
  test::Moments mean;
  for (int i = 0; i < 10000; ++i) {
    const LightSample s = lights.sample(splat(0.F), random.next(), random.pair());
    for (float v : test::lanes_of(s.value.x)) mean.add(v);
  }
  // A face of a cube seen from its center fills a sixth of the sphere.
  EXPECT_TRUE(test::has_mean(mean, 3 * 4 * kPiDouble / 6, 1e-6, 1e-4));
}

TEST(LightTable, EnvironmentsAddUp) {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{1, 2, 3}});
  b.emitter(scene::ConstantEmitter{{0.5F, 0.5F, 0.5F}});
  const Lights lights(b);
  EXPECT_TRUE(lights.table.has_environment());
  EXPECT_FLOAT_EQ(lane_value(lights.table.environment(splat(0, 1, 0), all_lanes()).y, 0), 2.5F);
  EXPECT_NEAR(lane_value(lights.table.environment_pdf(splat(0, 1, 0), all_lanes()), 0),
              1 / (4 * kPiDouble), 1e-7);
}

TEST(LightTable, ASceneWithoutLightIsEmpty) {
  SceneBuilder b;
  b.shape(scene::Sphere{}, b.diffuse(0.5F), b.area_light(0));
  EXPECT_TRUE(Lights(b).table.empty());
}

TEST(LightTable, ALightOfOneColourIsChosenToo) {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(scene::Sphere{{5, 0, 0}, 1}, grey, b.area_light(1));
  b.shape(scene::Sphere{{-5, 0, 0}, 1}, grey, b.emitter(scene::AreaEmitter{{0, 0, 1}}));
  const Lights lights(b);
  test::UniformLanes random(3);
  int blue = 0;
  for (int i = 0; i < 1000; ++i) {
    const LightSample s = lights.sample(splat(0.F), random.next(), random.pair());
    for (float x : test::lanes_of(s.direction.x)) blue += x < 0 ? 1 : 0;
  }
  // Its luminance is 7 % of the white one's.
  EXPECT_GT(blue, 8000 * 0.04);
  EXPECT_LT(blue, 8000 * 0.1);
}

TEST(LightTable, ExtremeChoicesPickALight) {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  for (int i = 0; i < 37; ++i)
    b.shape(test::disk({double(i), 0, 10}, 0.3, true), grey, b.area_light(1 + 0.01F * i));
  const Lights lights(b);
  for (float choice : {0.F, 0x1p-24F, 0.5F, kOneMinusEpsilon}) {
    const LightSample s = lights.sample(splat(10, 0, 0), Float(choice), {Float(0.5F), Float(0.5F)});
    EXPECT_TRUE(all(s.valid)) << choice;
  }
}

// Half of a disk's azimuths radiate: from a point of its axis half its solid angle is seen.
// H0: mean = radiance x solid angle / 2; 80,000 samples, rate 1e-6.
TEST(LightTable, ValuesOfATexturedLightIntegrateToWhatItShows) {
  SceneBuilder b;
  const scene::UvMatrix by_azimuth = {0, 0, 0.25F, 0, 1, 0};
  b.description().textures.push_back(
      {scene::CheckerboardTexture{{0.5F, 0.5F, 0.5F}, {0, 0, 0}, by_azimuth}, "", {}});
  b.shape(test::disk({0, 0, 2}, 1.5, true), b.diffuse(0.5F),
          b.emitter(scene::AreaEmitter{{{3, 3, 3}, 0}}));
  const Lights lights(b);
  EXPECT_TRUE(lights.table.wants_uv());
  test::UniformLanes random(4);
  test::Moments mean;
  for (int i = 0; i < 10000; ++i) {
    const LightSample s = lights.sample(splat(0.F), random.next(), random.pair());
    for (float v : test::lanes_of(s.value.x)) mean.add(v);
  }
  EXPECT_TRUE(test::has_mean(mean, 3 * 0.5 * kPiDouble * (1 - 2 / 2.5), 1e-6, 1e-4));
}

// One pixel of a map: a tent over two columns and two rows.
// H0: mean = its integral over directions; 80,000 samples, rate 1e-6.
TEST(LightTable, ValuesOfAMapIntegrateToItsRadiance) {
  constexpr int kWidth = 19, kHeight = 11, kRow = 3;
  SceneBuilder b;
  b.description().images.push_back(test::map_image(
      kWidth, kHeight, [](int x, int y) { return x == 18 && y == kRow ? 7.F : 0.F; }));
  b.emitter(scene::EnvironmentEmitter{0, 2});
  const Lights lights(b);
  test::UniformLanes random(5);
  test::Moments mean;
  for (int i = 0; i < 10000; ++i) {
    const LightSample s = lights.sample(splat(0.F), random.next(), random.pair());
    EXPECT_TRUE(all(s.valid));
    for (float v : test::lanes_of(s.value.x)) mean.add(v);
  }
  const double angle = kPiDouble / (kHeight - 1);
  // The integral of (1 - |t|) sin(angle (row + t)) over t in [-1, 1], times the angle.
  const double rows = std::sin(angle * kRow) * 2 * (1 - std::cos(angle)) / angle;
  const double integral = 2 * 7 * (2 * kPiDouble / kWidth) * rows;
  EXPECT_TRUE(test::has_mean(mean, integral, 1e-6, 1e-4 * integral));
  EXPECT_LT(std::sqrt(mean.variance()), 0.2 * integral);
}

TEST(LightTable, ABlackMapIsNoLight) {
  SceneBuilder b;
  b.description().images.push_back(test::map_image(4, 3, [](int, int) { return 0.F; }));
  b.emitter(scene::EnvironmentEmitter{0, 1});
  const Lights lights(b);
  EXPECT_TRUE(lights.table.empty());
  EXPECT_FALSE(lights.table.has_environment());
}

// Poles and the seam of the image lie between pixels like any other place.
TEST(LightTable, MapsHaveNoHoles) {
  SceneBuilder b;
  b.description().images.push_back(test::map_image(3, 4, [](int, int) { return 1.F; }));
  b.emitter(scene::EnvironmentEmitter{0, 1});
  const Lights lights(b);
  for (const Vec3& d : {splat(0, 1, 0), splat(0, -1, 0), splat(0, 0, -1), splat(-0.F, 0, -1),
                        splat(1e-20F, 0, -1), splat(-1e-20F, 0, -1), splat(-1, 0, 0)}) {
    EXPECT_NEAR(lane_value(lights.table.environment(d, all_lanes()).x, 0), 1, 1e-6);
    EXPECT_NEAR(lane_value(lights.table.environment_pdf(d, all_lanes()), 0), 1 / (4 * kPiDouble),
                1e-6);
  }
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(
      std::isnan(lane_value(lights.table.environment(splat(nan, nan, nan), all_lanes()).x, 0)));
}

// What a very dim light adds is not lost: it is chosen, with the probability it claims.
TEST(LightTable, TheDimmestLightIsChosen) {
  SceneBuilder b;
  b.emitter(scene::PointEmitter{{0, 0, 1}, {1e9F, 1e9F, 1e9F}});
  b.emitter(scene::PointEmitter{{0, 0, -2}, {1, 1, 1}});
  const Lights lights(b);
  const LightSample s = lights.sample(splat(0.F), Float(kOneMinusEpsilon), {Float(0), Float(0)});
  EXPECT_EQ(lane_value(s.direction.z, 0), -1);
  EXPECT_NEAR(lane_value(s.value.x, 0), 0x1p24 / 4, 1);
}

// Nor what a dim part of a map adds: beside it, its cells have less than 2^-24 of the row's light.
TEST(LightTable, TheDimmestPartOfAMapIsChosen) {
  SceneBuilder b;
  b.description().images.push_back(
      test::map_image(64, 2, [](int x, int) { return x == 10 ? 1e9F : 1.F; }));
  b.emitter(scene::EnvironmentEmitter{0, 1});
  const Lights lights(b);
  const LightSample s = lights.sample(splat(0.F), Float(0), {Float(kOneMinusEpsilon), Float(0.5F)});
  EXPECT_TRUE(all(s.valid));
  EXPECT_NEAR(lane_value(lights.table.environment(s.direction, all_lanes()).x, 0), 1, 1e-3);
  // One step of 2^-24 for a 64th of the sphere.
  EXPECT_NEAR(lane_value(s.pdf_solid_angle, 0) * 0x1p24 * (4 * kPiDouble / 64), 1, 1e-3);
}

}  // namespace
}  // namespace metrofarm::emitter
