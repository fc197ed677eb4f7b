// Rays that leave lights: how much power they carry, and that their densities are those of what
// they sample.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/emitter/lights.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::emitter {
namespace {

using test::Lights;
using test::SceneBuilder;

constexpr double kPiDouble = std::numbers::pi;
constexpr int kRays = 80000;

struct Case {
  const char* name;
  scene::SceneDescription scene;
  double power;  // W, of the green channel
};

scene::SceneDescription lit_by(const scene::Emitter& emitter) {
  SceneBuilder b;
  // A cube of edge 2 around the origin: the scene's sphere has radius sqrt(3).
  b.shape(test::box({-1, -1, -1}, {1, 1, 1}), b.diffuse(0.5F));
  b.description().emitters.push_back(emitter);
  return b.take();
}

template <class Geometry>
scene::SceneDescription radiating(const Geometry& geometry) {
  SceneBuilder b;
  b.shape(geometry, b.diffuse(0.5F), b.area_light(3));
  return b.take();
}

std::vector<Case> cases() {
  scene::SpotEmitter spot;
  spot.intensity.value = {2, 2, 2};
  spot.cutoff_degrees = spot.beam_width_degrees = 40;
  spot.to_world = {0, 0, 1, 3, 1, 0, 0, 2, 0, 1, 0, 1, 0, 0, 0, 1};
  scene::ProjectorEmitter projector;
  projector.irradiance.value = {2, 2, 2};
  projector.fov_x_degrees = 90;
  projector.aspect = 2;
  projector.to_world = spot.to_world;
  const double cap = 2 * kPiDouble * (1 - std::cos(40 * kPiDouble / 180));
  const double disk = 3 * kPiDouble;
  std::vector<Case> all;
  all.push_back(
      {"Quad", radiating(test::quad({0, 0, 0}, {2, 0, 0}, {0, 1.5, 0})), kPiDouble * 3 * 3});
  all.push_back({"Sphere", radiating(scene::Sphere{{1, 2, 3}, 0.5}), kPiDouble * 3 * kPiDouble});
  all.push_back({"Point", lit_by({scene::PointEmitter{{1, 2, 3}, {2, 2, 2}}, {}}), 8 * kPiDouble});
  all.push_back({"Spot", lit_by({spot, {}}), 2 * cap});
  // The image spans 2 x 1 at distance 1; Mitsuba's projector is pi times brighter.
  all.push_back({"Projector", lit_by({projector, {}}), kPiDouble * 2 * 2});
  all.push_back(
      {"Directional", lit_by({scene::DirectionalEmitter{{1, 2, 3}, {2, 2, 2}}, {}}), 2 * disk});
  all.push_back(
      {"Constant", lit_by({scene::ConstantEmitter{{2, 2, 2}}, {}}), 4 * kPiDouble * 2 * disk});
  return all;
}

class EmissionTest : public testing::TestWithParam<Case> {};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

// H0: the mean power of emitted rays is the light's. 80,000 rays, rate 1e-6; where power over
// density is constant only arithmetic may differ.
TEST_P(EmissionTest, CarriesTheLightsPower) {
  const Lights lights(GetParam().scene);
  test::UniformLanes random(3);
  test::Moments power;
  for (int i = 0; i < kRays; i += kLanes) {
    const Float choice = random.next();
    const Vec2 position = random.pair(), direction = random.pair();
    const Emission e = lights.table.emit(choice, position, direction, Float(0.F), all_lanes());
    for (int lane = 0; lane < kLanes; ++lane)
      power.add(test::lane_set(e.valid, lane) ? lane_value(e.power.y, lane) : 0.0);
  }
  EXPECT_TRUE(test::has_mean(power, GetParam().power, 1e-6, 1e-4 * GetParam().power));
}

// What sample() finds and what emit() makes are the same light: the density of a ray from the light
// to a point agrees with emission_over_direct() there.
TEST_P(EmissionTest, DensitiesOfBothDirectionsAgree) {
  const Lights lights(GetParam().scene);
  test::UniformLanes random(4);
  for (int i = 0; i < 200; ++i) {
    const Float choice = random.next();
    const Vec2 position = random.pair(), direction = random.pair();
    const Emission e = lights.table.emit(choice, position, direction, Float(0.F), all_lanes());
    const Float t(2.5F);
    const Vec3 reference = e.position + e.direction * t;
    const LightSample s = lights.sample(reference, choice, position);
    const Float direct = lights.table.direct_density(e, {reference}, all_lanes());
    const Float ratio = lights.table.emission_over_direct(s, all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!test::lane_set(e.valid & s.valid, lane)) continue;
      // Comparable where both name the same point: lights that leave sample() no choice.
      if (!test::lane_set(e.delta, lane)) continue;
      EXPECT_NEAR(lane_value(ratio * direct / e.pdf, lane), 1, 1e-3);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Lights, EmissionTest, testing::ValuesIn(cases()),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace metrofarm::emitter
