// Scenes whose radiance is known in closed form. H0 of each test: the mean of the paths is the
// analytic radiance; z-tests at a false-alarm rate of 1e-6, slack 1e-5 for single precision.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/trace.h"

namespace metrofarm::transport {
namespace {

using test::SceneBuilder;
using test::trace_paths;
using test::Traced;

constexpr double kFalseAlarm = 1e-6;

void expect_radiance(const Traced& traced, double expected) {
  EXPECT_TRUE(test::has_mean(traced.all, expected, kFalseAlarm, 1e-5 * expected));
  EXPECT_EQ(traced.bad, 0U);
  for (uint64_t n : traced.anomalies) EXPECT_EQ(n, 0U);
}

// Inside of an emissive diffuse sphere.
scene::SceneDescription closed_sphere(float reflectance, float radiance) {
  SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 2}, b.diffuse(reflectance), b.area_light(radiance), true);
  b.camera({0.5, -0.2, 0.1}, 70);
  return b.take();
}

PathSettings with(LightSampling sampling, int max_depth = -1) {
  PathSettings settings;
  settings.light_sampling = sampling;
  settings.max_depth = max_depth;
  return settings;
}

class FurnaceTest : public testing::TestWithParam<LightSampling> {};

TEST_P(FurnaceTest, AClosedEmissiveSphereGlowsAsTheGeometricSeries) {
  for (float rho : {0.0F, 0.5F, 0.8F})
    expect_radiance(trace_paths(closed_sphere(rho, 3), with(GetParam()), 40000, 1), 3 / (1 - rho));
}

TEST_P(FurnaceTest, ADepthLimitCutsTheSeries) {
  for (int depth : {1, 2, 3, 7}) {
    const double expected = 3 * (1 - std::pow(0.5, depth)) / (1 - 0.5);
    expect_radiance(trace_paths(closed_sphere(0.5F, 3), with(GetParam(), depth), 40000, 2),
                    expected);
  }
  expect_radiance(trace_paths(closed_sphere(0.5F, 3), with(GetParam(), 0), 800, 2), 0);
}

TEST_P(FurnaceTest, AnEnvironmentIsReflectedByTheAlbedo) {
  for (float rho : {1.F, 0.3F}) {
    SceneBuilder b;
    b.emitter(scene::ConstantEmitter{{2, 2, 2}});
    b.shape(scene::Sphere{{0, 0, 5}, 1}, b.diffuse(rho));
    b.camera({0, 0, 0}, 8);  // sees nothing but the sphere
    expect_radiance(trace_paths(b.take(), with(GetParam()), 100000, 3), 2 * rho);
  }
}

TEST_P(FurnaceTest, GlassInAnEnvironmentIsInvisible) {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{2, 2, 2}});
  b.shape(scene::Sphere{{0, 0, 5}, 1}, b.material(scene::Dielectric{1.5F, {1, 1, 1}, {1, 1, 1}}));
  b.camera({0, 0, 0}, 30);
  expect_radiance(trace_paths(b.take(), with(GetParam()), 100000, 4), 2);
}

TEST_P(FurnaceTest, FromWithinGlassAnEnvironmentIsBrighterByTheSquaredIndex) {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{2, 2, 2}});
  b.shape(scene::Sphere{{0, 0, 0}, 1}, b.material(scene::Dielectric{1.5F, {1, 1, 1}, {1, 1, 1}}));
  b.camera({0, 0, 0}, 40);
  expect_radiance(trace_paths(b.take(), with(GetParam()), 100000, 5), 2 * 2.25);
}

TEST_P(FurnaceTest, APerfectMirrorInAnEnvironmentIsInvisible) {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{2, 2, 2}});
  const scene::Index mirror = b.material(scene::Conductor{});
  b.shape(scene::Sphere{{-1.2, 0, 5}, 1}, mirror).shape(scene::Sphere{{1.2, 0, 5}, 1}, mirror);
  b.camera({0, 0, 0}, 40);
  expect_radiance(trace_paths(b.take(), with(GetParam()), 40000, 6), 2);
}

// A mixture: diffuse, rough metal and glass without absorption inside a glowing white room.
// Whatever is in it, the radiance in a closed isothermal cavity is the same everywhere: emission 1
// - rho.
TEST_P(FurnaceTest, AnIsothermalCavityHasOneRadiance) {
  SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 3}, b.diffuse(0.25F), b.area_light(0.75F), true);
  b.shape(scene::Sphere{{-0.8, 0, 1.5}, 0.7},
          b.material(scene::Dielectric{1.5F, {1, 1, 1}, {1, 1, 1}}));
  b.shape(scene::Sphere{{0.8, 0, 1.5}, 0.7}, b.material(scene::Conductor{}));
  b.shape(test::box({-0.5, -1.5, 0.5}, {0.5, -0.9, 1.5}), b.diffuse(0.5F), b.area_light(0.5F));
  b.camera({0, 0, -1}, 60);
  expect_radiance(trace_paths(b.take(), with(GetParam()), 100000, 7), 1);
}

INSTANTIATE_TEST_SUITE_P(Sampling, FurnaceTest,
                         testing::Values(LightSampling::kMis, LightSampling::kEmitter,
                                         LightSampling::kBsdf));

// Integrating sphere: direct irradiance I / R^2, then the series.
TEST(Furnace, APointLightFillsADiffuseSphereEvenly) {
  for (LightSampling sampling : {LightSampling::kMis, LightSampling::kEmitter}) {
    SceneBuilder b;
    b.emitter(scene::PointEmitter{{0, 0, 0}, {5, 5, 5}});
    b.shape(scene::Sphere{{0, 0, 0}, 2}, b.diffuse(0.6F), scene::kNone, true);
    b.camera({0.5, 0.3, -0.4}, 80);
    const double expected = 0.6 * 5 / (std::numbers::pi * 4 * (1 - 0.6));
    expect_radiance(trace_paths(b.take(), with(sampling), 60000, 8), expected);
  }
}

TEST(Furnace, RoughMetalIsNoBrighterThanItsSurroundings) {
  for (auto distribution : {scene::Microfacet::kGgx, scene::Microfacet::kBeckmann}) {
    SceneBuilder b;
    b.emitter(scene::ConstantEmitter{{1, 1, 1}});
    scene::RoughConductor metal;
    metal.distribution = distribution;
    metal.alpha_u = metal.alpha_v = 0.1F;
    b.shape(scene::Sphere{{0, 0, 5}, 1}, b.material(metal));
    b.camera({0, 0, 0}, 8);
    const Traced traced = trace_paths(b.take(), with(LightSampling::kMis), 100000, 9);
    EXPECT_LT(traced.all.mean(), 1);
    EXPECT_GT(traced.all.mean(), 0.95);
  }
}

TEST(Furnace, HiddenEmittersStillShine) {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{2, 2, 2}});
  b.shape(scene::Sphere{{0, 0, 5}, 1}, b.diffuse(1));
  PathSettings settings;
  settings.hide_emitters = true;
  b.camera({0, 0, 0}, 8);
  scene::SceneDescription towards = b.take();
  scene::SceneDescription away = towards;
  away.sensor.to_world = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1};
  expect_radiance(trace_paths(towards, settings, 40000, 10), 2);
  expect_radiance(trace_paths(away, settings, 800, 10), 0);
}

// A diffuse square under a small parallel square light: E = L A cos cos / d^2 in the limit. The
// light lies at the origin, its coordinates are small beside the distance: the shadow ray's
// rounding errors are those of the distance, and must not let the light hide itself.
TEST(Furnace, ASmallLightIlluminatesByTheInverseSquare) {
  SceneBuilder b;
  b.shape(test::quad({-1, -1, 10}, {0, 2, 0}, {2, 0, 0}), b.diffuse(0.5F));  // faces the camera
  b.shape(test::quad({-0.01, -0.01, 0}, {0.02, 0, 0}, {0, 0.02, 0}), b.diffuse(0),
          b.area_light(1000));
  b.camera({0, 0, 5}, 0.01);
  const double expected = 0.5 / std::numbers::pi * 1000 * 4e-4 / 100;
  const Traced traced = trace_paths(b.take(), with(LightSampling::kMis, 2), 8000, 11);
  EXPECT_NEAR(traced.all.mean() / expected, 1, 1e-4);
}

}  // namespace
}  // namespace metrofarm::transport
