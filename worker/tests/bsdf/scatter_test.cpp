// One suite for all materials that have a density: sampling, energy, reciprocity, finiteness.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/bsdf/cases.h"
#include "tests/support/histogram.h"
#include "tests/support/statistics.h"

namespace metrofarm::bsdf {
namespace {

using metrofarm::test::Double3;
using metrofarm::test::Histogram;
using metrofarm::test::Moments;
using metrofarm::test::UniformLanes;
using test::Below;
using test::MaterialCase;

struct Case {
  MaterialCase material;
  double cosine;  // of wo
};

std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (const MaterialCase& m : test::white_cases()) {
    for (double cosine : {1.0, 0.7, 0.2, 0.02, -0.7, -0.1}) {
      const double alpha = std::min(m.alpha_u, m.alpha_v);
      // Below this the half vector of a grazing mirror direction has no digits left in float.
      if (alpha < 0.005 && std::fabs(cosine) < 0.15) continue;
      if (cosine < 0 && m.below == Below::kNothing) continue;
      cases.push_back({m, cosine});
    }
  }
  return cases;
}

constexpr int kColumns = 20, kRows = 12, kPerCell = 24;

class ScatterTest : public testing::TestWithParam<Case> {
 protected:
  ScatterTest() : shown_(GetParam().material) {
    const double cosine = GetParam().cosine, sine = std::sqrt(1 - cosine * cosine);
    wo_ = metrofarm::test::splat(Double3{sine * std::cos(0.7), sine * std::sin(0.7), cosine});
    chart_ = test::chart_of(GetParam().material, normalize(metrofarm::test::lane_of(wo_, 0)));
    lobe_ = shown_.lobe(wo_);
  }

  Sample sample(UniformLanes& random) const {
    return shown_.materials().sample(lobe_, all_lanes(), wo_, {random.next(), random.pair()},
                                     Transport::kImportance);
  }
  Evaluation evaluate(const Vec3& wi, Transport transport = Transport::kImportance) const {
    return shown_.materials().evaluate(lobe_, all_lanes(), wo_, wi, transport);
  }

  // Integrates pdf and value over the cells of a grid by the midpoint rule, eight points at a time.
  void integrate(Histogram& pdf, Histogram& value) const;
  void integrate_packet(int row, int first, Histogram& pdf, Histogram& value) const;

  test::Shown shown_;
  Vec3 wo_ = splat(0.F);
  std::unique_ptr<test::Chart> chart_;
  ShownLobe lobe_;
};

void ScatterTest::integrate(Histogram& pdf, Histogram& value) const {
  for (int row = 0; row < pdf.rows() * kPerCell; ++row) {
    for (int first = 0; first < pdf.columns() * kPerCell; first += kLanes) {
      integrate_packet(row, first, pdf, value);
    }
  }
}

void ScatterTest::integrate_packet(int row, int first, Histogram& pdf, Histogram& value) const {
  const int columns = pdf.columns() * kPerCell, rows = pdf.rows() * kPerCell;
  metrofarm::test::Lanes x, y, z;
  double jacobian[kLanes];
  for (int lane = 0; lane < kLanes; ++lane) {
    const auto p = chart_->at((first + lane + 0.5) / columns, (row + 0.5) / rows);
    x[lane] = static_cast<float>(p.wi.x);
    y[lane] = static_cast<float>(p.wi.y);
    z[lane] = static_cast<float>(p.wi.z);
    // A half of the chart holds only directions of its own side.
    const auto [u, v] = chart_->locate(p.wi);
    const bool own = (u < 0.5) == ((first + lane + 0.5) / columns < 0.5);
    const bool halves = GetParam().material.below != Below::kNothing;
    jacobian[lane] = halves && !own ? 0 : p.jacobian / (double(columns) * rows);
  }
  using metrofarm::test::from_lanes;
  const Evaluation e = evaluate({from_lanes(x), from_lanes(y), from_lanes(z)});
  for (int lane = 0; lane < kLanes; ++lane) {
    if (jacobian[lane] == 0) continue;
    const int column = (first + lane) / kPerCell;
    pdf.add_to(column, row / kPerCell, lane_value(e.pdf_solid_angle, lane) * jacobian[lane]);
    value.add_to(column, row / kPerCell, lane_value(e.value.x, lane) * jacobian[lane]);
  }
}

double sum_of(const Histogram& h) {
  double sum = 0;
  for (double c : h.counts()) sum += c;
  return sum;
}

// H0: sample() draws with the density that evaluate() states, given that it does not fail; it
// succeeds with the probability that the density integrates to; and the mean of its weights is the
// albedo that quadrature of the value gives. 160,000 samples on 20 x 12 cells, false-alarm rate
// 1e-6 per case and statement. Slack of 4e-3 for the quadrature and for Beckmann's masking, whose
// approximation is this close. The albedo of a material without absorption
// is at most what its case says.
TEST_P(ScatterTest, SamplesFollowTheirPdfAndConserveEnergy) {
  constexpr int kSamples = 160000;
  Histogram observed(kColumns, kRows), density(kColumns, kRows), value(kColumns, kRows);
  integrate(density, value);
  UniformLanes random(31);
  Moments weights, mirrored, success;
  for (int i = 0; i < kSamples; i += kLanes) {
    const Sample s = sample(random);
    for (int lane = 0; lane < kLanes; ++lane) {
      const bool delta = metrofarm::test::lane_set(s.delta, lane);
      const bool valid = metrofarm::test::lane_set(s.valid, lane) && !delta;
      const double weight = lane_value(s.weight.x, lane);
      mirrored.add(delta ? weight : 0);
      weights.add(valid ? weight : 0);
      success.add(valid ? 1 : 0);
      if (!valid) continue;
      const auto [u, v] = chart_->locate(normalize(metrofarm::test::lane_of(s.wi, lane)));
      observed.add(u, v);
    }
  }
  const double total = sum_of(density), albedo = sum_of(value);
  EXPECT_TRUE(metrofarm::test::has_mean(success, total, 1e-6, 4e-3));
  EXPECT_TRUE(metrofarm::test::has_mean(weights, albedo, 1e-6, 4e-3));
  Histogram expected(kColumns, kRows);
  for (int c = 0; c < kColumns; ++c)
    for (int r = 0; r < kRows; ++r)
      expected.add_to(c, r, sum_of(observed) / total * density.counts()[r * kColumns + c]);
  EXPECT_TRUE(metrofarm::test::follows(observed.counts(), expected.counts(), 1e-6));
  EXPECT_LE(albedo + mirrored.mean(),
            GetParam().material.most_energy + 4e-3 + 5 * mirrored.standard_error());
}

TEST_P(ScatterTest, WeightsAreValueOverPdf) {
  // What the rounding error of a direction changes in a narrow lobe.
  const double alpha = std::min(GetParam().material.alpha_u, GetParam().material.alpha_v);
  const double rounding = 1e-3 + 4e-6 / (alpha * std::fabs(GetParam().cosine));
  UniformLanes random(32);
  for (int i = 0; i < 400; ++i) {
    const Sample s = sample(random);
    const Evaluation e = evaluate(s.wi);
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!metrofarm::test::lane_set(s.valid & ~s.delta, lane)) continue;
      const double pdf = lane_value(s.pdf_solid_angle, lane);
      const double pdf_there = lane_value(e.pdf_solid_angle, lane);
      EXPECT_GT(pdf, 0);
      EXPECT_NEAR(pdf_there, pdf, rounding * pdf);
      const double value = lane_value(e.value.y, lane);
      EXPECT_NEAR(lane_value(s.weight.y, lane) * pdf_there, value, 1e-3 * value);
    }
  }
}

// f(wo, wi) of radiance is f(wi, wo) of importance: what is carried there is gathered back.
TEST_P(ScatterTest, IsReciprocal) {
  if (!GetParam().material.reciprocal) return;
  const double alpha = std::min(GetParam().material.alpha_u, GetParam().material.alpha_v);
  const double rounding = 1e-3 + 1e-5 / (alpha * std::sqrt(std::fabs(GetParam().cosine)));
  UniformLanes random(33);
  for (int i = 0; i < 200; ++i) {
    const Sample s = sample(random);
    const Evaluation there = evaluate(s.wi, Transport::kRadiance);
    const Evaluation back = shown_.materials().evaluate(shown_.lobe(s.wi), all_lanes(), s.wi, wo_,
                                                        Transport::kImportance);
    for (int lane = 0; lane < kLanes; ++lane) {
      const double cosine = std::fabs(lane_value(s.wi.z, lane));
      if (!metrofarm::test::lane_set(s.valid & ~s.delta, lane) || cosine < 1e-3) continue;
      const double f = lane_value(there.value.x, lane) / cosine;
      const double f_back = lane_value(back.value.x, lane) / std::fabs(GetParam().cosine);
      EXPECT_NEAR(f, f_back, rounding * f + 1e-7);
    }
  }
}

TEST_P(ScatterTest, NothingLeavesOnTheWrongSide) {
  if (GetParam().material.below != Below::kNothing) return;
  UniformLanes random(35);
  for (int i = 0; i < 200; ++i) {
    Vec3 wi = random.direction();
    wi.z = -xsimd::abs(wi.z);
    const Evaluation behind =
        shown_.materials().evaluate(shown_.lobe(wi), all_lanes(), wi, wo_, Transport::kRadiance);
    for (const Evaluation& e : {evaluate(wi), behind}) {
      EXPECT_EQ(metrofarm::test::lanes_of(e.value.x), metrofarm::test::Lanes{});
      EXPECT_EQ(metrofarm::test::lanes_of(e.pdf_solid_angle), metrofarm::test::Lanes{});
    }
  }
}

bool all_finite(const Vec3& v, Mask lanes) {
  for (Float f : {v.x, v.y, v.z})
    if (any(lanes & ~(xsimd::abs(f) < Float(3e38F)))) return false;
  return true;
}

// Grazing and nearly grazing directions, the pole, and the borders of the unit square.
TEST_P(ScatterTest, NumbersAreFiniteEverywhere) {
  UniformLanes random(36);
  const float borders[] = {0.F, 0x1p-24F, 0.5F, kOneMinusEpsilon};
  for (float cosine : {1.F, 0.5F, 1e-3F, 1e-5F, 1e-7F}) {
    for (float side : {1.F, -1.F}) {
      const float z = side * cosine;
      const Vec3 wo = splat(std::sqrt(1 - z * z), 0.F, z);
      const ShownLobe lobe = shown_.lobe(wo);
      for (int i = 0; i < 64; ++i) {
        const SampleInput u{i % 2 == 0 ? random.next() : Float(borders[i % 4]),
                            {Float(borders[i / 4 % 4]), Float(borders[i / 16])}};
        const Sample s = shown_.materials().sample(lobe, all_lanes(), wo, u, Transport::kRadiance);
        EXPECT_TRUE(all_finite(s.weight, s.valid)) << cosine;
        EXPECT_TRUE(all_finite(s.wi, s.valid)) << cosine;
        EXPECT_TRUE(all_finite({s.pdf_solid_angle, s.eta, s.eta}, s.valid & ~s.delta)) << cosine;
        Vec3 wi = random.direction();
        if (i % 2 == 0) wi = normalize(Vec3{wi.x, wi.y, wi.z * Float(1e-5F)});
        const Evaluation e =
            shown_.materials().evaluate(lobe, all_lanes(), wo, wi, Transport::kRadiance);
        EXPECT_TRUE(all_finite(e.value, all_lanes())) << cosine;
        EXPECT_TRUE(all_finite({e.pdf_solid_angle, Float(0.F), Float(0.F)}, all_lanes()));
      }
    }
  }
}

std::string name_of(const testing::TestParamInfo<Case>& tested) {
  const double cosine = tested.param.cosine;
  return tested.param.material.name + (cosine < 0 ? "_below_" : "_at_") +
         std::to_string(std::lround(1000 * std::fabs(cosine)));
}

INSTANTIATE_TEST_SUITE_P(Materials, ScatterTest, testing::ValuesIn(all_cases()), name_of);

}  // namespace
}  // namespace metrofarm::bsdf
