#include "bsdf/materials.h"

#include <gtest/gtest.h>

#include "tests/support/lane_tools.h"

namespace metrofarm::bsdf {
namespace {

std::vector<scene::Bsdf> one_of_each() {
  scene::RoughConductor ggx;
  ggx.distribution = scene::Microfacet::kGgx;
  return {{scene::Diffuse{{0.1F, 0.2F, 0.3F}}, "", {}},
          {scene::Conductor{}, "", {}},
          {scene::RoughConductor{}, "", {}},
          {ggx, "", {}},
          {scene::Dielectric{}, "", {}},
          {scene::TwoSided{0, 1}, "", {}},
          {scene::Diffuse{{0.7F, 0.8F, 0.9F}}, "", {}},
          {scene::TwoSided{0, 6}, "", {}}};
}

const Int kMixed = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);

TEST(Materials, EachLaneMeetsItsOwnMaterial) {
  const Materials materials(one_of_each());
  metrofarm::test::UniformLanes random(1);
  for (int i = 0; i < 200; ++i) {
    Vec3 wo = random.direction();
    wo.z = xsimd::abs(wo.z) + Float(0.01F);
    wo = normalize(wo);
    const SampleInput u{random.next(), random.pair()};
    const ShownLobe mixed = materials.shown(kMixed, all_lanes(), all_lanes());
    const Sample together = materials.sample(mixed, all_lanes(), wo, u);
    for (int m = 0; m < kLanes; ++m) {
      const ShownLobe lobe = materials.shown(Int(m), all_lanes(), all_lanes());
      const Sample alone = materials.sample(lobe, all_lanes(), wo, u);
      EXPECT_EQ(lane_value(together.wi.x, m), lane_value(alone.wi.x, m));
      EXPECT_EQ(lane_value(together.weight.y, m), lane_value(alone.weight.y, m));
      EXPECT_EQ(lane_value(together.pdf_solid_angle, m), lane_value(alone.pdf_solid_angle, m));
      EXPECT_EQ(bits(together.valid) >> m & 1, bits(alone.valid) >> m & 1);
      EXPECT_EQ(bits(together.delta) >> m & 1, bits(alone.delta) >> m & 1);
    }
  }
}

TEST(Materials, OnlyDeltaLobesAreNotSmooth) {
  const Materials materials(one_of_each());
  const ShownLobe front = materials.shown(kMixed, all_lanes(), all_lanes());
  EXPECT_EQ(bits(materials.smooth(front, all_lanes())), 0b11101101U);
  const ShownLobe back = materials.shown(kMixed, no_lanes(), all_lanes());
  EXPECT_EQ(bits(materials.smooth(back, all_lanes())), 0b10000000U) << "others are black or delta";
}

TEST(Materials, TwoSidedShowsItsOtherMaterialBehindAndTurnsTheFrame) {
  const Materials materials(one_of_each());
  const ShownLobe front = materials.shown(Int(7), all_lanes(), all_lanes());
  const ShownLobe back = materials.shown(Int(7), no_lanes(), all_lanes());
  EXPECT_TRUE(none(front.turned));
  EXPECT_TRUE(all(back.turned));
  const Vec3 up = splat(0, 0, 1);
  EXPECT_FLOAT_EQ(lane_value(materials.evaluate(front, all_lanes(), up, up).value.x, 0),
                  0.1F * kInvPi);
  EXPECT_FLOAT_EQ(lane_value(materials.evaluate(back, all_lanes(), up, up).value.x, 0),
                  0.7F * kInvPi);
}

TEST(Materials, OneSidedMaterialsAreBlackBehind) {
  const Materials materials(one_of_each());
  for (int m : {0, 1, 2, 3}) {
    const ShownLobe back = materials.shown(Int(m), no_lanes(), all_lanes());
    EXPECT_TRUE(all(equal(back.kind, Int(-1)))) << m;
    const Sample s = materials.sample(back, all_lanes(), splat(0, 0, -1),
                                      {Float(0.5F), {Float(0.5F), Float(0.5F)}});
    EXPECT_TRUE(none(s.valid));
  }
  const ShownLobe glass = materials.shown(Int(4), no_lanes(), all_lanes());
  EXPECT_TRUE(none(glass.turned)) << "glass sees both sides in one frame";
}

TEST(Materials, OnlyAnisotropyWantsTangents) {
  EXPECT_FALSE(Materials(one_of_each()).wants_tangent());
  scene::RoughConductor brushed;
  brushed.alpha_u = 0.3F;
  EXPECT_TRUE(Materials({{brushed, "", {}}}).wants_tangent());
}

// Brushed metal spreads light across the direction in which it is rough.
TEST(Materials, AnisotropyFollowsTheTangent) {
  for (auto distribution : {scene::Microfacet::kGgx, scene::Microfacet::kBeckmann}) {
    scene::RoughConductor brushed;
    brushed.distribution = distribution;
    brushed.alpha_u = 0.4F;
    brushed.alpha_v = 0.05F;
    const Materials materials({{brushed, "", {}}});
    const ShownLobe lobe = materials.shown(Int(0), all_lanes(), all_lanes());
    metrofarm::test::UniformLanes random(9);
    double along = 0, across = 0;
    for (int i = 0; i < 2000; ++i) {
      const Sample s =
          materials.sample(lobe, all_lanes(), splat(0, 0, 1), {random.next(), random.pair()});
      for (int lane = 0; lane < kLanes; ++lane) {
        along += std::fabs(lane_value(s.wi.x, lane));
        across += std::fabs(lane_value(s.wi.y, lane));
      }
    }
    EXPECT_GT(along, 4 * across);
  }
}

}  // namespace
}  // namespace metrofarm::bsdf
