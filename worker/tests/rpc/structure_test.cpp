#include "rpc/structure.h"

#include <gtest/gtest.h>

#include "tests/support/room.h"

namespace metrofarm::rpc {
namespace {

using metrofarm::scene::Index;

TEST(Structure, OfTheRoom) {
  const auto s = structure_of(test::room());
  EXPECT_EQ(s.shapes(), 6U);
  EXPECT_EQ(s.delta_shapes(), 1U);  // the glass sphere
  EXPECT_EQ(s.masked_shapes(), 0U);
  EXPECT_EQ(s.extended_lights(), 2U);
  EXPECT_EQ(s.delta_lights(), 1U);
  EXPECT_EQ(s.environment_maps(), 0U);
  EXPECT_EQ(s.distant_lights(), 0U);
  EXPECT_FALSE(s.lens());
  EXPECT_FALSE(s.motion());
  EXPECT_FALSE(s.hide_emitters());
}

// The traits of a shape of this material.
struct Traits {
  uint32_t masked, delta;
  bool operator==(const Traits&) const = default;
};
template <class Model>
Traits traits_of(Model model) {
  test::SceneBuilder b;
  b.diffuse(0.5F);                     // 0
  b.material(scene::Dielectric{});     // 1
  b.material(scene::Conductor{});      // 2
  b.material(scene::Mask{{0.5F}, 1});  // 3
  const Index material = b.material(model);
  b.shape(scene::Sphere{{0, 0, 0}, 1}, material);
  const auto s = structure_of(b.take());
  return {s.masked_shapes(), s.delta_shapes()};
}

TEST(Structure, MaterialsAreLookedInto) {
  EXPECT_EQ(traits_of(scene::Diffuse{}), (Traits{0, 0}));
  EXPECT_EQ(traits_of(scene::RoughDielectric{}), (Traits{0, 0}));
  EXPECT_EQ(traits_of(scene::Plastic{}), (Traits{0, 0}));  // its base is diffuse
  EXPECT_EQ(traits_of(scene::ThinDielectric{}), (Traits{0, 1}));
  EXPECT_EQ(traits_of(scene::TwoSided{2, 2}), (Traits{0, 1}));
  EXPECT_EQ(traits_of(scene::TwoSided{2, 0}), (Traits{0, 0}));
  EXPECT_EQ(traits_of(scene::Blend{{0.5F}, 1, 2}), (Traits{0, 1}));
  EXPECT_EQ(traits_of(scene::Blend{{0.5F}, 0, 2}), (Traits{0, 0}));
  EXPECT_EQ(traits_of(scene::Mask{{0.5F}, 0}), (Traits{1, 0}));
  EXPECT_EQ(traits_of(scene::Blend{{0.5F}, 2, 3}), (Traits{1, 1}));
  EXPECT_EQ(traits_of(scene::Null{}), (Traits{1, 1}));
}

TEST(Structure, SensorAndSky) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 1}, b.diffuse(0.5F));
  b.emitter(scene::ConstantEmitter{});
  b.emitter(scene::DirectionalEmitter{});
  scene::SceneDescription d = b.take();
  d.sensor.projection = scene::Projection::kThinLens;
  d.sensor.aperture_radius = 0.1;
  d.sensor.motion.keys.resize(3);
  for (size_t i = 0; i < 3; ++i) d.sensor.motion.keys[i].time = static_cast<double>(i);
  d.sensor.motion.keys[0].to_world[3] = 1;  // stands still from the second key on
  d.integrator.hide_emitters = true;
  const auto s = structure_of(d);
  EXPECT_TRUE(s.lens());
  EXPECT_TRUE(s.motion());
  ASSERT_EQ(s.moving_size(), 1);
  EXPECT_EQ(s.moving(0).begin(), 0);
  EXPECT_EQ(s.moving(0).end(), 1);
  EXPECT_TRUE(s.hide_emitters());
  EXPECT_EQ(s.extended_lights(), 1U);
  EXPECT_EQ(s.delta_lights(), 1U);
  EXPECT_EQ(s.distant_lights(), 2U);
  d.sensor.aperture_radius = 0;
  EXPECT_FALSE(structure_of(d).lens());
}

}  // namespace
}  // namespace metrofarm::rpc
