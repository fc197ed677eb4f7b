#include "work_unit/target_map.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/support/lane_tools.h"
#include "tests/work_unit/support.h"
#include "work_unit/render_target.h"

namespace metrofarm::work_unit {
namespace {

float factor_at(const TargetMap& map, float x, float y) {
  return lane_value(map.factor(Float(x), Float(y), all_lanes()), 3);
}

TEST(TargetMap, InterpolatesBetweenCellCentres) {
  const TargetMap map({2, {1, 0.5F, 0.25F, 0.125F}}, 40, 20);
  EXPECT_FALSE(map.empty());
  EXPECT_FLOAT_EQ(factor_at(map, 10, 5), 1);
  EXPECT_FLOAT_EQ(factor_at(map, 30, 5), 2);
  EXPECT_FLOAT_EQ(factor_at(map, 10, 15), 4);
  EXPECT_FLOAT_EQ(factor_at(map, 30, 15), 8);
  EXPECT_FLOAT_EQ(factor_at(map, 20, 5), 1 / 0.75F);
  EXPECT_FLOAT_EQ(factor_at(map, 20, 10), 4 / 1.875F);
}

TEST(TargetMap, IsConstantBeyondTheOutermostCentres) {
  const TargetMap map({2, {1, 0.5F, 0.25F, 0.125F}}, 40, 20);
  EXPECT_FLOAT_EQ(factor_at(map, -3, -3), 1);
  EXPECT_FLOAT_EQ(factor_at(map, 43, 0), 2);
  EXPECT_FLOAT_EQ(factor_at(map, 0, 23), 4);
  EXPECT_FLOAT_EQ(factor_at(map, 40, 20), 8);
}

TEST(LightMap, CountsForTheNearestCell) {
  LightMap map(128, 64);
  map.add(0, 0, 1);
  map.add(-2, -2, 2);
  map.add(127.9F, 63.9F, 4);
  map.add(130, 70, 8);
  map.add(5, 3.5F, 16);
  EXPECT_EQ(map.sums()[0], 3);
  EXPECT_EQ(map.sums().back(), 12);
  EXPECT_EQ(map.sums()[3 * LightMap::kSide + 2], 16);
}

// f under a map is the luminance of each splat over the map's value where it lands; what it brings
// back is the same.
TEST(TargetMap, DividesTheTarget) {
  for (Under under : {Under::kPath, Under::kBdpt}) {
    const test::Job job(Integrator::kPssmlt);
    Spec spec = job.context.spec();
    spec.under = under;
    const Context plain(job.scene, spec);
    spec.target_map = {2, {1, 0.5F, 0.25F, 0.125F}};
    ASSERT_EQ(problem_with(spec), "");
    const Context mapped(job.scene, spec);
    RenderTarget by_luminance(plain), by_map(mapped);
    const TargetMap map(spec.target_map, spec.width, spec.height);
    primary_space::IndependentSource source(rng_key(3, RngDomain::kTest));
    int raised = 0;
    for (uint64_t i = 0; i < 4000; i += kLanes) {
      source.begin(i);
      const auto all = all_lanes();
      const auto f = metrofarm::test::lanes_of(
          by_luminance.evaluate(source, metropolis::Which::kProposal, all));
      const auto g =
          metrofarm::test::lanes_of(by_map.evaluate(source, metropolis::Which::kProposal, all));
      for (int lane = 0; lane < kLanes; ++lane) {
        double wanted = 0;
        for (const RenderTarget::LaneSplat& s : by_map.proposal(lane).splats) {
          const Spectrum rgb{Float(s.rgb[0]), Float(s.rgb[1]), Float(s.rgb[2])};
          wanted += double(lane_value(luminance(rgb), 0)) * factor_at(map, s.x, s.y);
        }
        EXPECT_NEAR(g[lane], wanted, 1e-5 * wanted);
        EXPECT_GE(g[lane], f[lane] * 0.9999F);
        raised += g[lane] > 1.5F * f[lane];
      }
    }
    EXPECT_GT(raised, 1000);
  }
}

TEST(TargetMap, BadMapsAreNamed) {
  Spec spec = test::Job::spec_of(Integrator::kPssmlt);
  EXPECT_EQ(problem_with(spec), "");
  spec.target_map = {2, {1, 1, 1}};
  EXPECT_NE(problem_with(spec).find("target_map"), std::string::npos);
  spec.target_map = {1, {0}};
  EXPECT_NE(problem_with(spec).find("target_map"), std::string::npos);
}

}  // namespace
}  // namespace metrofarm::work_unit
