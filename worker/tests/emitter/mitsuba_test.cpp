// Lights against Mitsuba's.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "tests/emitter/lights.h"
#include "tests/emitter/mitsuba_reference.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::emitter {
namespace {

using test::Lights;
using test::SceneBuilder;

scene::Matrix matrix(const double (&values)[16]) {
  scene::Matrix m;
  std::copy(std::begin(values), std::end(values), m.begin());
  return m;
}

Vec3 splat3(const float (&v)[3]) {
  return splat(v[0], v[1], v[2]);
}

// Angles and matrices are rounded: in a spot's outermost part the falloff is a difference of nearly
// equal angles.
constexpr double kTolerance = 1e-4;

void expect_same(SceneBuilder& builder, std::span<const mitsuba::LitPoint> rows) {
  const Lights lights(builder);
  int lit = 0;
  for (const mitsuba::LitPoint& row : rows) {
    const LightSample s = lights.sample(splat3(row.point), Float(0.5F), {Float(0.5F), Float(0.5F)});
    const auto value = test::lane_of(s.value, 0), d = test::lane_of(s.direction, 0);
    const double scale = std::max({row.value[0], row.value[1], row.value[2]});
    EXPECT_NEAR(value.x, row.value[0], kTolerance * scale);
    EXPECT_NEAR(value.y, row.value[1], kTolerance * scale);
    EXPECT_NEAR(value.z, row.value[2], kTolerance * scale);
    EXPECT_EQ(any(s.valid), row.value[0] > 0);
    if (none(s.valid)) continue;
    ++lit;
    EXPECT_TRUE(all(s.delta));
    EXPECT_EQ(lane_value(s.pdf_solid_angle, 0), 0);
    EXPECT_NEAR(d.x, row.direction[0], 1e-6);
    EXPECT_NEAR(d.y, row.direction[1], 1e-6);
    EXPECT_NEAR(d.z, row.direction[2], 1e-6);
  }
  EXPECT_GT(lit, 10);
}

constexpr scene::Rgb kRgb = {2, 3, 4};

scene::Index checkers(SceneBuilder& b) {
  b.description().textures.push_back(
      {scene::CheckerboardTexture{
           {0.9F, 0.2F, 0.1F}, {0.1F, 0.3F, 0.7F}, {3.7F, 0, 0.13F, 0, 2.1F, 0.29F}},
       "",
       {}});
  return 0;
}

scene::SpotEmitter spot(const scene::Colour& intensity) {
  return {matrix(mitsuba::kPlace), intensity, 35, 10};
}

scene::ProjectorEmitter projector(const scene::Colour& irradiance) {
  return {matrix(mitsuba::kPlace), irradiance, 50, 1};
}

TEST(AgainstMitsuba, PointLight) {
  SceneBuilder b;
  b.emitter(scene::PointEmitter{{1, 2, 3}, kRgb});
  expect_same(b, mitsuba::kPoint);
}

TEST(AgainstMitsuba, Spot) {
  SceneBuilder b;
  b.emitter(spot({kRgb}));
  expect_same(b, mitsuba::kSpot);
}

TEST(AgainstMitsuba, TexturedSpot) {
  SceneBuilder b;
  b.emitter(spot({kRgb, checkers(b)}));
  expect_same(b, mitsuba::kTexturedSpot);
}

TEST(AgainstMitsuba, Projector) {
  SceneBuilder b;
  b.emitter(projector({kRgb}));
  expect_same(b, mitsuba::kProjector);
}

TEST(AgainstMitsuba, TexturedProjector) {
  SceneBuilder b;
  b.emitter(projector({{1, 1, 1}, checkers(b)}));
  expect_same(b, mitsuba::kTexturedProjector);
}

TEST(AgainstMitsuba, DirectionalLight) {
  SceneBuilder b;
  b.emitter(scene::DirectionalEmitter{{1, 2, -0.5}, kRgb});
  expect_same(b, mitsuba::kDirectional);
}

TEST(AgainstMitsuba, EnvironmentMap) {
  using namespace mitsuba;
  SceneBuilder b;
  std::vector<float> pixels(std::begin(kMapPixels), std::end(kMapPixels));
  b.description().images.push_back({kMapWidth, kMapHeight, 3, std::move(pixels), false});
  b.emitter(scene::EnvironmentEmitter{0, kMapScale, matrix(kMapPlace)});
  const Lights lights(b);
  for (const SeenDirection& row : kMap) {
    const Spectrum s = lights.table.environment(splat3(row.direction), all_lanes());
    EXPECT_NEAR(lane_value(s.x, 0), row.radiance[0], 2e-4);
    EXPECT_NEAR(lane_value(s.y, 0), row.radiance[1], 2e-4);
    EXPECT_NEAR(lane_value(s.z, 0), row.radiance[2], 2e-4);
  }
}

}  // namespace
}  // namespace metrofarm::emitter
