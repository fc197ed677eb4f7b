// How materials are put together: lanes, sides, wrappers, textures.
#include "bsdf/materials.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/bsdf/cases.h"
#include "tests/support/statistics.h"

namespace metrofarm::bsdf {
namespace {

using metrofarm::test::Moments;
using metrofarm::test::UniformLanes;
using test::Shown;

template <class... Models>
std::vector<scene::Bsdf> list(const Models&... models) {
  return {scene::Bsdf{models, "", {}}...};
}

scene::Diffuse grey(float value) {
  return {{value, value, value}};
}

std::vector<scene::Bsdf> one_of_each() {
  scene::RoughConductor ggx;
  ggx.distribution = scene::Microfacet::kGgx;
  return list(scene::Diffuse{{0.1F, 0.2F, 0.3F}}, scene::Conductor{}, scene::Plastic{}, ggx,
              scene::Dielectric{}, scene::TwoSided{0, 1}, scene::Principled{},
              scene::TwoSided{0, 6});
}

const Int kMixed = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);

ShownLobe show(const Shown& shown, Int bsdf, const Vec3& wo, Float choice = Float(0.5F)) {
  const ShadingPoint at{{}, splat(1, 0, 0), splat(0, 1, 0), wo};
  return shown.materials().show(bsdf, at, choice, all_lanes());
}

Evaluation evaluate(const Shown& shown, const ShownLobe& lobe, const Vec3& wo, const Vec3& wi) {
  return shown.materials().evaluate(lobe, all_lanes(), wo, wi, Transport::kRadiance);
}

TEST(Materials, EachLaneMeetsItsOwnMaterial) {
  const Shown shown(one_of_each());
  UniformLanes random(1);
  for (int i = 0; i < 200; ++i) {
    Vec3 wo = random.direction();
    wo = normalize(Vec3{wo.x, wo.y, xsimd::abs(wo.z) + Float(0.01F)});
    const SampleInput u{random.next(), random.pair()};
    const auto sample = [&](Int bsdf) {
      return shown.materials().sample(show(shown, bsdf, wo), all_lanes(), wo, u,
                                      Transport::kRadiance);
    };
    const Sample together = sample(kMixed);
    for (int m = 0; m < kLanes; ++m) {
      const Sample alone = sample(Int(m));
      EXPECT_EQ(bits(together.valid) >> m & 1, bits(alone.valid) >> m & 1);
      EXPECT_EQ(bits(together.delta) >> m & 1, bits(alone.delta) >> m & 1);
      if ((bits(alone.valid) >> m & 1) == 0) continue;
      EXPECT_EQ(lane_value(together.wi.x, m), lane_value(alone.wi.x, m));
      EXPECT_EQ(lane_value(together.weight.y, m), lane_value(alone.weight.y, m));
      EXPECT_EQ(lane_value(together.pdf_solid_angle, m), lane_value(alone.pdf_solid_angle, m));
    }
  }
}

TEST(Materials, SmoothMeansThatSomeDensityIsThere) {
  const Shown shown(one_of_each());
  const ShownLobe front = show(shown, kMixed, splat(0, 0, 1));
  EXPECT_EQ(bits(shown.materials().smooth(front, all_lanes())), 0b11101101U);
  const ShownLobe back = show(shown, kMixed, splat(0, 0, -1));
  EXPECT_EQ(bits(shown.materials().smooth(back, all_lanes())), 0b11000000U);
}

TEST(Materials, TwoSidedShowsItsOtherMaterialBehindAndTurnsTheFrame) {
  const Shown shown(list(scene::TwoSided{1, 2}, grey(0.25F), grey(0.75F)));
  const ShownLobe front = show(shown, Int(0), splat(0, 0, 1));
  const ShownLobe back = show(shown, Int(0), splat(0, 0, -1));
  EXPECT_TRUE(none(front.turned));
  EXPECT_TRUE(all(back.turned));
  const Vec3 up = splat(0, 0, 1);
  EXPECT_FLOAT_EQ(lane_value(evaluate(shown, front, up, up).value.x, 0), 0.25F * kInvPi);
  EXPECT_FLOAT_EQ(lane_value(evaluate(shown, back, up, up).value.x, 0), 0.75F * kInvPi);
}

TEST(Materials, OneSidedMaterialsAreBlackFromBehind) {
  const Shown shown(one_of_each());
  for (int m : {0, 1, 2, 3}) {
    const ShownLobe back = show(shown, Int(m), splat(0, 0, -1));
    EXPECT_TRUE(all(equal(back.kind, Int(kBlack)))) << m;
  }
  EXPECT_TRUE(none(show(shown, Int(4), splat(0, 0, -1)).turned)) << "glass sees both sides";
}

// H0: of 80,000 choices the share that meets the nested material is its opacity, and inside it the
// share of the blend's second is its weight, so the choice was rescaled well. 1e-6 each.
TEST(Materials, MaskAndBlendChooseWithTheirWeights) {
  const Shown shown(list(scene::Mask{{0.3F}, 1}, scene::Blend{{0.6F}, 2, 3}, grey(0), grey(1)));
  EXPECT_TRUE(shown.materials().wants_choice());
  UniformLanes random(4);
  Moments opaque, second;
  const Vec3 up = splat(0, 0, 1);
  for (int i = 0; i < 10000; ++i) {
    const ShownLobe lobe = show(shown, Int(0), up, random.next());
    const Evaluation e = evaluate(shown, lobe, up, up);
    const Mask smooth = shown.materials().smooth(lobe, all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      const bool is_opaque = metrofarm::test::lane_set(smooth, lane);
      opaque.add(is_opaque ? 1 : 0);
      if (is_opaque) second.add(lane_value(e.value.x, lane) > 0 ? 1 : 0);
    }
  }
  EXPECT_TRUE(metrofarm::test::has_mean(opaque, 0.3, 1e-6));
  EXPECT_TRUE(metrofarm::test::has_mean(second, 0.6, 1e-6));
}

scene::Texture checkers(const scene::Rgb& a, const scene::Rgb& b) {
  return {scene::CheckerboardTexture{{a}, {b}}, "", {}};
}

TEST(Materials, TexturesMultiplyColoursAndNumbers) {
  scene::RoughConductor metal;
  metal.specular_reflectance = {{0.5F, 1, 1}, 0};
  metal.alpha_u = {0.5F, 1};
  metal.alpha_v = {0.2F};
  const Shown shown(list(metal, scene::Diffuse{}), {checkers({0.5F, 0.6F, 0.7F}, {1, 1, 1}),
                                                    checkers({0.4F, 0.4F, 0.4F}, {1, 1, 1})});
  EXPECT_TRUE(shown.materials().needs().uv);
  EXPECT_TRUE(shown.materials().needs().tangents);
  using Lobe = RoughConductorLobe<Beckmann>;
  const ShownLobe dark = shown.lobe(splat(0, 0, 1)),
                  light = shown.lobe(splat(0, 0, 1), Float(0.5F), 0.75F);
  const auto column = [](const ShownLobe& lobe, int c) {
    return lane_value(lobe.parameters.columns[c], 3);
  };
  EXPECT_FLOAT_EQ(column(dark, Lobe::kReflectance), 0.25F);
  EXPECT_FLOAT_EQ(column(dark, Lobe::kReflectance + 2), 0.7F);
  EXPECT_NEAR(column(dark, Lobe::kAlphaU), 0.2F, 1e-6);
  EXPECT_FLOAT_EQ(column(light, Lobe::kReflectance), 0.5F);
  EXPECT_FLOAT_EQ(column(light, Lobe::kAlphaU), 0.5F);
  EXPECT_FLOAT_EQ(column(light, Lobe::kAlphaV), 0.2F);
}

TEST(Materials, PlainMaterialsNeedNothing) {
  const Shown shown(one_of_each());
  EXPECT_FALSE(shown.materials().needs().uv);
  EXPECT_FALSE(shown.materials().needs().tangents);
  EXPECT_FALSE(shown.materials().wants_choice());
}

// As Mitsuba 3.9.1's normalmap around a rough conductor of alpha_u = 0.3, alpha_v = 0.1 and around
// two-sided grey (mitsuba_normals.py): the frame, the shadow of Conty Estevez and the flip.
struct KnownNormal {
  double numbers[10];  // colour of the map, wo, wi, value
};
constexpr KnownNormal kMapped[] = {
#include "tests/bsdf/mitsuba_normals.inc"
};

TEST(Materials, NormalMapsAgreeWithMitsuba) {
  scene::RoughConductor metal;
  metal.distribution = scene::Microfacet::kGgx;
  metal.alpha_u = {0.3F};
  metal.alpha_v = {0.1F};
  for (const KnownNormal& k : kMapped) {
    const auto vec = [&](int at) {
      return metrofarm::test::splat(
          metrofarm::test::Double3{k.numbers[at], k.numbers[at + 1], k.numbers[at + 2]});
    };
    scene::Rgb rgb;
    for (int c = 0; c < 3; ++c) rgb[c] = static_cast<float>(k.numbers[c]);
    const Shown shown(list(scene::NormalMap{0, 1}, scene::TwoSided{2, 2}, metal),
                      {checkers(rgb, rgb)});
    const Vec3 wo = vec(3);
    Vec3 o = wo, i = vec(6);
    const ShownLobe lobe = shown.lobe(wo);
    EXPECT_TRUE(all(lobe.bent));
    if (all(lobe.turned)) {
      o.z = -o.z;
      i.z = -i.z;
    }
    const double value = lane_value(evaluate(shown, lobe, o, i).value.x, 0);
    EXPECT_NEAR(value, k.numbers[9], 2e-3 * k.numbers[9] + 1e-6);
  }
}

// H0: sampled directions under a steep normal map have the density that evaluate() states, seen by
// the mean of value / pdf. 80,000 samples, 1e-6; slack for 3e-3 of quadrature.
TEST(Materials, SamplesUnderANormalMapAreWeightedByTheirValue) {
  const scene::Rgb rgb = {0.8F, 0.35F, 0.8F};
  const Shown shown(list(scene::NormalMap{0, 1}, grey(1)), {checkers(rgb, rgb)});
  const Vec3 wo = normalize(splat(0.3F, -0.5F, 0.6F));
  const ShownLobe lobe = shown.lobe(wo);
  UniformLanes random(7);
  Moments sampled, uniform;
  for (int i = 0; i < 10000; ++i) {
    const Sample s = shown.materials().sample(lobe, all_lanes(), wo, {random.next(), random.pair()},
                                              Transport::kRadiance);
    const Evaluation there = evaluate(shown, lobe, wo, s.wi);
    const Evaluation e = evaluate(shown, lobe, wo, random.direction());
    for (int lane = 0; lane < kLanes; ++lane) {
      uniform.add(lane_value(e.value.x, lane) * 4 * kPi);
      const bool valid = metrofarm::test::lane_set(s.valid, lane);
      sampled.add(valid ? lane_value(s.weight.x, lane) : 0);
      if (!valid) continue;
      const double product = lane_value(s.weight.x * s.pdf_solid_angle, lane);
      EXPECT_NEAR(lane_value(there.value.x, lane), product, 1e-3 * product + 1e-6);
    }
  }
  EXPECT_TRUE(metrofarm::test::same_mean(sampled, uniform, 1e-6));
}

// A ramp that climbs 1 along u, scaled by 2: the normal leans against u with a tangent of 2.
TEST(Materials, BumpMapsTiltTheNormalAgainstTheSlope) {
  scene::Image ramp;
  ramp.width = 4;
  ramp.height = 1;
  ramp.channels = 1;
  ramp.pixels = std::vector<float>{0, 0.25F, 0.5F, 0.75F};
  scene::BitmapTexture bitmap;
  bitmap.image = 0;
  const Shown shown(list(scene::BumpMap{{2, 0}, 1}, grey(1)), {{bitmap, "", {}}}, {ramp});
  const ShownLobe lobe = shown.lobe(splat(0, 0, 1), Float(0.5F), 0.5F, 0.5F);
  EXPECT_TRUE(shown.materials().needs().tangents);
  const double tangent = -lane_value(lobe.inner.n.x, 0) / lane_value(lobe.inner.n.z, 0);
  EXPECT_NEAR(tangent, 2, 1e-3);
  EXPECT_NEAR(lane_value(lobe.inner.n.y, 0), 0, 1e-6);
}

}  // namespace
}  // namespace metrofarm::bsdf
