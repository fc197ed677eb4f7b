// One harness for all lobes that have a density, through Materials, over materials and angles.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "bsdf/materials.h"
#include "tests/bsdf/chart.h"
#include "tests/support/histogram.h"
#include "tests/support/statistics.h"

namespace metrofarm::bsdf {
namespace {

using metrofarm::test::Double3;
using metrofarm::test::Histogram;
using metrofarm::test::Moments;

struct Case {
  const char* name;
  scene::Bsdf bsdf;
  double alpha_u, alpha_v;  // 0: no microfacets
  double cosine;            // of wo
};

scene::Bsdf rough(scene::Microfacet distribution, float alpha_u, float alpha_v) {
  // No index, so no absorption: the white furnace.
  scene::RoughConductor c;
  c.distribution = distribution;
  c.alpha_u = alpha_u;
  c.alpha_v = alpha_v;
  return {c, "", {}};
}

std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (double cosine : {1.0, 0.7, 0.2, 0.02}) {
    cases.push_back({"diffuse", {scene::Diffuse{{1, 1, 1}}, "", {}}, 0, 0, cosine});
    for (float alpha : {0.5F, 0.1F, 0.01F, 0.001F}) {
      // Below this the half vector of a grazing mirror direction has no digits left in float.
      if (alpha < 0.005F && cosine < 0.1) continue;
      cases.push_back({"ggx", rough(scene::Microfacet::kGgx, alpha, alpha), alpha, alpha, cosine});
      cases.push_back(
          {"beckmann", rough(scene::Microfacet::kBeckmann, alpha, alpha), alpha, alpha, cosine});
    }
    cases.push_back({"ggx", rough(scene::Microfacet::kGgx, 0.3F, 0.05F), 0.3F, 0.05F, cosine});
    cases.push_back(
        {"beckmann", rough(scene::Microfacet::kBeckmann, 0.05F, 0.3F), 0.05F, 0.3F, cosine});
  }
  return cases;
}

class LobeTest : public testing::TestWithParam<Case> {
 protected:
  LobeTest() : materials_({GetParam().bsdf}) {
    const double sine = std::sqrt(1 - GetParam().cosine * GetParam().cosine);
    wo_ = metrofarm::test::splat(
        Double3{sine * std::cos(0.7), sine * std::sin(0.7), GetParam().cosine});
    const Double3 wo = normalize(metrofarm::test::lane_of(wo_, 0));
    if (GetParam().alpha_u > 0) {
      chart_ = std::make_unique<test::HalfVectorChart>(wo, GetParam().alpha_u, GetParam().alpha_v);
    } else {
      chart_ = std::make_unique<test::SphereChart>();
    }
    lobe_ = materials_.shown(Int(0), all_lanes(), all_lanes());
  }

  Sample sample(metrofarm::test::UniformLanes& random) const {
    return materials_.sample(lobe_, all_lanes(), wo_, {random.next(), random.pair()});
  }
  Evaluation evaluate(const Vec3& wo, const Vec3& wi) const {
    return materials_.evaluate(lobe_, all_lanes(), wo, wi);
  }

  // Integrates pdf and value over the cells of a grid by the midpoint rule, eight points at a time.
  void integrate(Histogram& pdf, Histogram& value) const;

  Materials materials_;
  Vec3 wo_ = splat(0.F);
  std::unique_ptr<test::Chart> chart_;
  ShownLobe lobe_;
};

void LobeTest::integrate(Histogram& pdf, Histogram& value) const {
  constexpr int kPerCell = 24;
  const double area = 1.0 / (pdf.columns() * pdf.rows() * kPerCell * kPerCell);
  for (int row = 0; row < pdf.rows() * kPerCell; ++row) {
    for (int first = 0; first < pdf.columns() * kPerCell; first += kLanes) {
      metrofarm::test::Lanes x, y, z;
      double jacobian[kLanes];
      for (int lane = 0; lane < kLanes; ++lane) {
        const auto p = chart_->at((first + lane + 0.5) / (pdf.columns() * kPerCell),
                                  (row + 0.5) / (pdf.rows() * kPerCell));
        x[lane] = static_cast<float>(p.wi.x);
        y[lane] = static_cast<float>(p.wi.y);
        z[lane] = static_cast<float>(p.wi.z);
        jacobian[lane] = p.jacobian * area;
      }
      using metrofarm::test::from_lanes;
      const Evaluation e = evaluate(wo_, {from_lanes(x), from_lanes(y), from_lanes(z)});
      for (int lane = 0; lane < kLanes; ++lane) {
        const int column = (first + lane) / kPerCell;
        pdf.add_to(column, row / kPerCell, lane_value(e.pdf_solid_angle, lane) * jacobian[lane]);
        value.add_to(column, row / kPerCell, lane_value(e.value.x, lane) * jacobian[lane]);
      }
    }
  }
}

double sum_of(const Histogram& h) {
  double sum = 0;
  for (double c : h.counts()) sum += c;
  return sum;
}

// H0: sample() draws with the density that evaluate() states, and fails with the probability that
// the density leaves over. 200,000 samples on 20 x 12 cells, false-alarm rate 1e-6 per case.
TEST_P(LobeTest, SamplesFollowTheirPdf) {
  constexpr int kSamples = 200000;
  Histogram observed(20, 12), density(20, 12), value(20, 12), expected(20, 12);
  integrate(density, value);
  metrofarm::test::UniformLanes random(31);
  for (int i = 0; i < kSamples; i += kLanes) {
    const Sample s = sample(random);
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!metrofarm::test::lane_set(s.valid, lane)) {
        observed.add_outside();
        continue;
      }
      const auto [u, v] = chart_->locate(normalize(metrofarm::test::lane_of(s.wi, lane)));
      observed.add(u, v);
    }
  }
  for (int c = 0; c < 20; ++c)
    for (int r = 0; r < 12; ++r) expected.add_to(c, r, kSamples * density.counts()[r * 20 + c]);
  const double total = sum_of(density);
  EXPECT_LE(total, 1 + 2e-3);
  // Where no sample fails, quadrature errors must not pass for an expected failure.
  if (total > 1 - 1e-3 && observed.counts().back() == 0) {
    expected.add_outside(0);
  } else {
    expected.complete_to(kSamples);
  }
  EXPECT_TRUE(metrofarm::test::follows(observed.counts(), expected.counts(), 1e-6));
}

TEST_P(LobeTest, WeightsAreValueOverPdf) {
  metrofarm::test::UniformLanes random(32);
  for (int i = 0; i < 500; ++i) {
    const Sample s = sample(random);
    const Evaluation e = evaluate(wo_, s.wi);
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!metrofarm::test::lane_set(s.valid, lane)) continue;
      const float pdf = lane_value(s.pdf_solid_angle, lane);
      EXPECT_GT(pdf, 0);
      EXPECT_NEAR(lane_value(e.pdf_solid_angle, lane), pdf, 1e-4 * pdf);
      const float value = lane_value(e.value.y, lane);
      EXPECT_NEAR(lane_value(s.weight.y, lane) * pdf, value, 1e-4 * value);
      EXPECT_GT(lane_value(s.wi.z, lane), 0);
    }
  }
}

TEST_P(LobeTest, IsReciprocal) {
  metrofarm::test::UniformLanes random(33);
  for (int i = 0; i < 500; ++i) {
    const Sample s = sample(random);
    const Evaluation there = evaluate(wo_, s.wi), back = evaluate(s.wi, wo_);
    for (int lane = 0; lane < kLanes; ++lane) {
      const double cosine = lane_value(s.wi.z, lane);
      if (!metrofarm::test::lane_set(s.valid, lane) || cosine < 1e-3) continue;
      const double f = lane_value(there.value.x, lane) / cosine;
      const double f_back = lane_value(back.value.x, lane) / GetParam().cosine;
      EXPECT_NEAR(f, f_back, 1e-3 * f);
    }
  }
}

// H0: the albedo of a lobe without absorption is what quadrature of its value says, and at most 1.
// 200,000 samples, false-alarm rate 1e-6 per case; slack for the quadrature.
TEST_P(LobeTest, AWhiteFurnaceIsNotBrighter) {
  Histogram density(20, 12), value(20, 12);
  integrate(density, value);
  const double albedo = sum_of(value);
  EXPECT_LE(albedo, 1 + 2e-3);
  metrofarm::test::UniformLanes random(34);
  Moments weights;
  for (int i = 0; i < 200000; i += kLanes) {
    const Sample s = sample(random);
    for (float w : metrofarm::test::lanes_of(keep(s.valid, s.weight.z))) weights.add(w);
  }
  EXPECT_TRUE(metrofarm::test::has_mean(weights, albedo, 1e-6, 2e-3));
  if (GetParam().cosine > 0.5) {
    EXPECT_GT(albedo, GetParam().alpha_u > 0.2 ? 0.6 : 0.95);
  }
}

TEST_P(LobeTest, NothingIsScatteredBelowTheSurface) {
  metrofarm::test::UniformLanes random(35);
  for (int i = 0; i < 200; ++i) {
    Vec3 wi = random.direction();
    wi.z = -xsimd::abs(wi.z);
    for (const Evaluation& e : {evaluate(wo_, wi), evaluate(wi, wo_)}) {
      EXPECT_EQ(metrofarm::test::lanes_of(e.value.x), metrofarm::test::Lanes{});
      EXPECT_EQ(metrofarm::test::lanes_of(e.pdf_solid_angle), metrofarm::test::Lanes{});
    }
  }
}

std::string name_of(const testing::TestParamInfo<Case>& tested) {
  const Case& c = tested.param;
  const auto per_mille = [](double v) { return std::to_string(std::lround(1000 * v)); };
  return std::string(c.name) + "_" + per_mille(c.alpha_u) + "_" + per_mille(c.alpha_v) + "_at_" +
         per_mille(c.cosine);
}

INSTANTIATE_TEST_SUITE_P(Lobes, LobeTest, testing::ValuesIn(all_cases()), name_of);

}  // namespace
}  // namespace metrofarm::bsdf
