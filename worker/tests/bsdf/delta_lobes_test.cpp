// Lobes that scatter into a discrete set of directions.
#include <gtest/gtest.h>

#include <cmath>

#include "bsdf/fresnel.h"
#include "tests/bsdf/cases.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::bsdf {
namespace {

using metrofarm::test::Double3;
using metrofarm::test::lane_of;
using metrofarm::test::lanes_of;

Vec3 at_cosine(double cosine) {
  const double sine = std::sqrt(1 - cosine * cosine);
  return metrofarm::test::splat(Double3{0.6 * sine, -0.8 * sine, cosine});
}

Sample sample_of(const scene::Bsdf& bsdf, const Vec3& wo, float lobe,
                 Transport transport = Transport::kRadiance) {
  const test::Shown shown(std::vector{bsdf});
  return shown.materials().sample(shown.lobe(wo), all_lanes(), wo,
                                  {Float(lobe), {Float(0.3F), Float(0.6F)}}, transport);
}

TEST(Conductor, MirrorsWithFresnelReflectance) {
  scene::Conductor metal{{0.2F, 0.9F, 1.1F}, {3.9F, 2.4F, 2.1F}, {1, 0.5F, 0.25F}};
  for (double cosine : {1.0, 0.6, 0.01}) {
    const Vec3 wo = at_cosine(cosine);
    const Sample s = sample_of({metal, "", {}}, wo, 0.5F);
    EXPECT_TRUE(all(s.valid & s.delta));
    EXPECT_EQ(lanes_of(s.wi.x), lanes_of(-wo.x));
    EXPECT_EQ(lanes_of(s.wi.y), lanes_of(-wo.y));
    EXPECT_EQ(lanes_of(s.wi.z), lanes_of(wo.z));
    const auto fresnel = [&](float eta, float k) {
      return lane_value(fresnel_conductor(wo.z, Float(eta), Float(k)), 0);
    };
    EXPECT_FLOAT_EQ(lane_value(s.weight.x, 0), fresnel(0.2F, 3.9F));
    EXPECT_FLOAT_EQ(lane_value(s.weight.y, 0), 0.5F * fresnel(0.9F, 2.4F));
    EXPECT_FLOAT_EQ(lane_value(s.weight.z, 0), 0.25F * fresnel(1.1F, 2.1F));
  }
}

TEST(Conductor, IsBlackFromBehind) {
  const Sample s = sample_of({scene::Conductor{}, "", {}}, at_cosine(-0.5), 0.5F);
  EXPECT_TRUE(none(s.valid));
}

class DielectricTest : public testing::TestWithParam<std::tuple<double, double>> {};

TEST_P(DielectricTest, RefractsBySnellAndReflectsByMirror) {
  const auto [eta, cosine] = GetParam();
  const scene::Bsdf glass{scene::Dielectric{static_cast<float>(eta), {1, 1, 1}, {1, 1, 1}}, "", {}};
  const Vec3 wo = at_cosine(cosine);
  const double passed = cosine > 0 ? eta : 1 / eta;  // index beyond over index before
  const Double3 o = lane_of(wo, 0);

  const Sample mirror = sample_of(glass, wo, 0.F);
  EXPECT_NEAR(lane_of(mirror.wi, 0).z, o.z, 1e-7);
  EXPECT_EQ(lane_value(mirror.eta, 0), 1.F);
  EXPECT_EQ(lane_value(mirror.weight.x, 0), 1.F);

  const Sample refracted = sample_of(glass, wo, kOneMinusEpsilon);
  const Double3 i = lane_of(refracted.wi, 0);
  EXPECT_TRUE(all(refracted.valid & refracted.delta));
  EXPECT_NEAR(length(i), 1, 1e-6);
  if ((1 - cosine * cosine) / (passed * passed) >= 1) {
    EXPECT_GT(i.z * o.z, 0) << "total internal reflection";
    return;
  }
  EXPECT_LT(i.z * o.z, 0);
  // Snell: the tangential components scale by the ratio of the indices.
  EXPECT_NEAR(i.x * passed, -o.x, 1e-6);
  EXPECT_NEAR(i.y * passed, -o.y, 1e-6);
  EXPECT_NEAR(lane_value(refracted.eta, 0), passed, 1e-6);
  EXPECT_NEAR(lane_value(refracted.weight.y, 0), 1 / (passed * passed), 1e-5);
}

// R + T = 1 in energy: radiance times eta^2 on the far side. H0: the mean of weight eta^2 over the
// lobe choice is 1, and reflection is chosen with the Fresnel probability. 80,000 samples, 1e-6.
TEST_P(DielectricTest, LosesNoEnergy) {
  const auto [eta, cosine] = GetParam();
  const test::Shown glass(std::vector<scene::Bsdf>{
      {scene::Dielectric{static_cast<float>(eta), {1, 1, 1}, {1, 1, 1}}, "", {}}});
  const Vec3 wo = at_cosine(cosine);
  const ShownLobe shown = glass.lobe(wo);
  metrofarm::test::UniformLanes random(5);
  metrofarm::test::Moments energy, reflected;
  for (int i = 0; i < 10000; ++i) {
    const Sample s = glass.materials().sample(shown, all_lanes(), wo,
                                              {random.next(), random.pair()}, Transport::kRadiance);
    const auto e = lanes_of(s.weight.x * sqr(s.eta));
    for (int lane = 0; lane < kLanes; ++lane) {
      energy.add(e[lane]);
      reflected.add(lane_value(s.wi.z, lane) * cosine > 0 ? 1 : 0);
    }
  }
  EXPECT_NEAR(energy.mean(), 1, 1e-5);
  const double passed = cosine > 0 ? eta : 1 / eta;
  const auto boundary = fresnel_dielectric(Float(static_cast<float>(std::fabs(cosine))),
                                           Float(static_cast<float>(passed)));
  EXPECT_TRUE(
      metrofarm::test::has_mean(reflected, lane_value(boundary.reflectance, 0), 1e-6, 1e-6));
}

// Through the surface and back the same way.
TEST_P(DielectricTest, PathsAreReversible) {
  const auto [eta, cosine] = GetParam();
  const scene::Bsdf glass{scene::Dielectric{static_cast<float>(eta), {1, 1, 1}, {1, 1, 1}}, "", {}};
  const Vec3 wo = at_cosine(cosine);
  const Sample there = sample_of(glass, wo, kOneMinusEpsilon);
  if (lane_of(there.wi, 0).z * cosine > 0) return;
  const Sample back = sample_of(glass, there.wi, kOneMinusEpsilon);
  EXPECT_NEAR(length(lane_of(back.wi, 0) - lane_of(wo, 0)), 0, 2e-5);
  EXPECT_NEAR(lane_value(there.weight.x * back.weight.x, 0), 1, 1e-5);
}

INSTANTIATE_TEST_SUITE_P(Glass, DielectricTest,
                         testing::Combine(testing::Values(1.5046 / 1.000277, 1.33, 2.4, 0.7),
                                          testing::Values(1.0, 0.8, 0.3, -0.3, -0.8, -1.0)));

TEST(Dielectric, TransmittanceAndReflectanceTintTheirPart) {
  const scene::Bsdf glass{scene::Dielectric{1.5F, {0.9F, 0.8F, 0.7F}, {0.6F, 0.5F, 0.4F}}, "", {}};
  const Sample mirror = sample_of(glass, at_cosine(0.5), 0.F);
  EXPECT_FLOAT_EQ(lane_value(mirror.weight.y, 0), 0.8F);
  const Sample refracted = sample_of(glass, at_cosine(0.5), 0.99F);
  EXPECT_FLOAT_EQ(lane_value(refracted.weight.z, 0), 0.4F / 2.25F);
}

TEST(Dielectric, ImportanceIsNotScaledByRefraction) {
  const scene::Bsdf glass{scene::Dielectric{1.5F, {1, 1, 1}, {1, 1, 1}}, "", {}};
  const Sample s = sample_of(glass, at_cosine(0.5), 0.99F, Transport::kImportance);
  EXPECT_EQ(lane_value(s.weight.x, 0), 1.F);
}

// Two faces reflect R + T R T + T R^3 T + ... = 2 R / (1 + R) and pass the rest straight on.
TEST(ThinDielectric, PassesLightStraight) {
  const scene::Bsdf sheet{
      scene::ThinDielectric{1.5F, {0.9F, 0.8F, 0.7F}, {0.6F, 0.5F, 0.4F}}, "", {}};
  for (double cosine : {0.9, 0.3, -0.3}) {
    const Vec3 wo = at_cosine(cosine);
    const float once = lane_value(fresnel_dielectric(xsimd::abs(wo.z), Float(1.5F)).reflectance, 0);
    const float both = 2 * once / (1 + once);
    const Sample mirror = sample_of(sheet, wo, both - 1e-3F);
    EXPECT_EQ(lanes_of(mirror.wi.z), lanes_of(wo.z));
    EXPECT_FLOAT_EQ(lane_value(mirror.weight.x, 0), 0.9F);
    const Sample passed = sample_of(sheet, wo, both + 1e-3F);
    EXPECT_EQ(lanes_of(passed.wi.x), lanes_of(-wo.x));
    EXPECT_EQ(lanes_of(passed.wi.z), lanes_of(-wo.z));
    EXPECT_FLOAT_EQ(lane_value(passed.weight.z, 0), 0.4F);
    EXPECT_EQ(lane_value(passed.eta, 0), 1.F);
    EXPECT_TRUE(all(passed.delta & mirror.delta));
  }
}

TEST(Null, IsNotThere) {
  for (double cosine : {0.9, -0.3}) {
    const Sample s = sample_of({scene::Null{}, "", {}}, at_cosine(cosine), 0.5F);
    EXPECT_TRUE(all(s.valid & s.delta));
    EXPECT_EQ(lanes_of(s.wi.z), lanes_of(-at_cosine(cosine).z));
    EXPECT_EQ(lane_value(s.weight.x, 0), 1.F);
  }
}

}  // namespace
}  // namespace metrofarm::bsdf
