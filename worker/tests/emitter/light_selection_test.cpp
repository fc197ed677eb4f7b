#include "emitter/light_selection.h"

#include <gtest/gtest.h>

#include "tests/emitter/lights.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::emitter {
namespace {

using Light = LightSelection::Light;

Light at(double x, double power) {
  Light light{power, false, {}};
  light.bounds.lower = {x - 0.1, 0, 0};
  light.bounds.upper = {x + 0.1, 0.1, 0};
  light.bounds.normals.cosine = kAllDirections;
  light.bounds.intensity = power;
  return light;
}

float probability(const LightSelection& selection, int light, float x) {
  return lane_value(selection.probability(Int(light), {splat(x, 0, 1), splat(0.F)}, all_lanes()),
                    0);
}

TEST(LightSelection, LightsFarAwayHaveTheirHalf) {
  for (int near : {1, 2, 3, 40}) {
    std::vector<Light> lights = {{3e9, true, {}}, {1e9, true, {}}};
    for (int i = 0; i < near; ++i) lights.push_back(at(i, 1e-3 * (i + 1)));
    const LightSelection selection(lights);
    EXPECT_EQ(selection.has_tree(), near > 2);
    EXPECT_NEAR(probability(selection, 0, 1), 0.375, 1e-5);
    EXPECT_NEAR(probability(selection, 1, 1), 0.125, 1e-5);
    EXPECT_EQ(selection.probability_infinitely_far(0), probability(selection, 0, 1));
  }
}

TEST(LightSelection, WithoutPowerNothingIsChosen) {
  const LightSelection selection({at(0, 0), at(1, 1), at(2, 1), at(3, 0), at(4, 1), at(5, 1)});
  EXPECT_TRUE(selection.has_tree());
  float sum = 0;
  for (int i = 0; i < 6; ++i) sum += probability(selection, i, 1);
  EXPECT_EQ(sum, 1);
  EXPECT_EQ(probability(selection, 0, 1), 0);
  EXPECT_EQ(probability(selection, 3, 1), 0);
}

// H0: lights are chosen as often as probability() says, which is what choose() says too. 80,000
// choices of 20 lights for each of three receivers, with and without a tree, family rate 1e-6.
TEST(LightSelection, ChoosesWithTheProbabilityThatItStates) {
  test::UniformLanes random(21);
  for (int near : {2, 18}) {
    std::vector<Light> lights;
    for (int i = 0; i < near; ++i) lights.push_back(at(i, 1 + i % 3));
    lights.push_back({5, true, {}});
    lights.push_back({2, true, {}});
    const LightSelection selection(lights);
    for (float x : {-3.F, 4.5F, 12.F}) {
      std::vector<double> observed(lights.size()), expected(lights.size());
      for (size_t i = 0; i < lights.size(); ++i)
        expected[i] = 80000 * double(probability(selection, static_cast<int>(i), x));
      for (int i = 0; i < 10000; ++i) {
        const LightChoice c =
            selection.choose(random.next(), {splat(x, 0, 1), splat(0.F)}, all_lanes());
        for (int lane = 0; lane < kLanes; ++lane) {
          const uint32_t light = lane_word(as_uint(c.light), lane);
          ++observed.at(light);
          EXPECT_EQ(80000 * double(lane_value(c.probability, lane)), expected[light]);
        }
      }
      EXPECT_TRUE(test::follows(observed, expected, test::sidak(1e-6, 6)));
    }
  }
}

// Beside a light of the same place and intensity that shines everywhere.
double share_beside_omnidirectional(const LightBounds& bounds, const Vec3& position) {
  LightBounds all = bounds;
  all.normals.cosine = kAllDirections;
  const LightTree tree({{bounds, 0}, {all, 1}}, 2);
  constexpr int32_t kSteps = 1 << 20;
  const Int steps = tree.steps_of(Int(0), kSteps, {position, splat(0.F)}, all_lanes());
  const double own = lane_word(as_uint(steps), 0);
  return own / (kSteps - own);
}

// Bounds hold what lights do: a point that a light sends the fraction c of its greatest intensity
// to takes it for one that sends c or more.
TEST(LightSelection, BoundsOfAreaLightsHoldWhereTheyShine) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(test::box({-1, -0.5, 1}, {1.5, 0.5, 2}), grey, b.area_light(3));
  b.shape(test::quad({-2, 1, 1}, {1, 0, 0}, {0, 0, 1}), grey, b.area_light(3), true);
  b.shape(test::disk({0, 4, 3}, 1.5, true), grey, b.area_light(1));
  scene::TriangleMesh leaning = test::quad({-1, -1, -4}, {2, 0, 0}, {0, 2, 0});
  leaning.normals = {0.8F, 0, 0.6F, 0, 0.8F, 0.6F, 0, 0, 1, -0.8F, 0, 0.6F};
  b.shape(leaning, grey, b.area_light(1), true);
  const test::Lights lights(b);
  const AreaLights areas(lights.scene, lights.primitives, lights.placements, lights.textures);
  test::UniformLanes random(22);
  int checked = 0;
  for (int light = 0; light < areas.count(); ++light) {
    const auto primitive = static_cast<uint32_t>(areas.primitive(light));
    const double area = geometry::area_of(lights.primitives, primitive);
    for (int i = 0; i < 300; ++i) {
      const Vec3 at = test::splat(test::lane_of(random.direction() * Float(6.F), 0));
      const LightSample s = areas.sample(Int(light), {at}, random.pair(), all_lanes());
      const double share = share_beside_omnidirectional(areas.bounds(light), at);
      for (int lane = 0; lane < kLanes; ++lane) {
        if (!test::lane_set(s.valid, lane)) continue;
        const double distance = lane_value(s.distance, lane);
        const double cosine = distance * distance / area / lane_value(s.pdf_solid_angle, lane);
        EXPECT_GE(share, 0.999 * cosine - 1e-3);
        ++checked;
      }
    }
  }
  EXPECT_GT(checked, 10000);
}

TEST(LightSelection, BoundsOfDeltaLightsHoldWhereTheyShine) {
  test::SceneBuilder b;
  const scene::Matrix turned = {-1, 0, 0, 3, 0, 0.6, 0.8, 0, 0, 0.8, -0.6, 5, 0, 0, 0, 1};
  const scene::Matrix skewed = {-1, 0.4, 0, 3, 0, 0.6, 0.8, 0, 0, 0.8, -1.6, 5, 0, 0, 0, 1};
  for (const scene::Matrix& m : {turned, skewed}) {
    b.emitter(scene::SpotEmitter{m, {{9, 9, 9}}, 35, 10});
    b.emitter(scene::SpotEmitter{m, {{9, 9, 9}}, 25, 25});
    b.emitter(scene::ProjectorEmitter{m, {{9, 9, 9}}, 50, 1.5});
  }
  const test::Lights lights(b);
  const DeltaLights deltas(lights.scene.emitters, BoundingSphere{{0, 0, 0}, 10}, {},
                           lights.textures);
  test::UniformLanes random(23);
  int checked = 0;
  for (int light = 0; light < deltas.count(); ++light) {
    for (int i = 0; i < 2000; ++i) {
      const Vec3 at = test::splat(test::lane_of(random.direction() * Float(6.F), 0));
      const LightSample s = deltas.sample(Int(light), {at}, all_lanes());
      if (none(s.valid)) continue;
      EXPECT_GE(share_beside_omnidirectional(deltas.bounds(light), at), 0.1);
      ++checked;
    }
  }
  EXPECT_GT(checked, 500);
}

}  // namespace
}  // namespace metrofarm::emitter
