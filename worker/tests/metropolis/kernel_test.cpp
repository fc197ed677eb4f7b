// H0 of the chi-square tests: displacements follow the kernel's law. 400,000 steps, 20 x 20 cells,
// fixed seeds, false-alarm rate 1e-5 each.
#include "metropolis/kernel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

using primary_space::FixedPair;
using test::Histogram;

constexpr int kSteps = 400000;
constexpr double kFalseAlarm = 1e-5;

struct Displacement {
  double x, y;
};

double signed_turns(uint32_t from, uint32_t to) {
  return static_cast<double>(static_cast<int32_t>(to - from)) * 0x1p-32;
}

// Steps from random points.
void for_each_step(const Kernel& kernel, uint64_t seed,
                   const std::function<void(Displacement)>& visit) {
  const Stepper stepper(kernel);
  test::UniformLanes random(seed);
  for (int i = 0; i < kSteps; i += kLanes) {
    const FixedPair from{random.word(), random.word()};
    const UInt w0 = random.word(), w1 = random.word();
    const FixedPair to = stepper.step(from, w0, w1);
    for (int lane = 0; lane < kLanes; ++lane)
      visit({signed_turns(lane_word(from.first, lane), lane_word(to.first, lane)),
             signed_turns(lane_word(from.second, lane), lane_word(to.second, lane))});
  }
}

void expect_uniform(const Histogram& observed) {
  Histogram expected(observed.columns(), observed.rows());
  for (int c = 0; c < observed.columns(); ++c)
    for (int r = 0; r < observed.rows(); ++r)
      expected.add_to(c, r, double(kSteps) / (observed.columns() * observed.rows()));
  EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), kFalseAlarm));
}

Kernel gaussian(double sigma) {
  return {.kind = KernelKind::kGaussian, .sigma = sigma};
}

// ln(s2 / r) / ln(s2 / s1) and the angle are uniform.
TEST(KelemenPair, RadiusAndAngleFollowTheirLaw) {
  const Kernel kernel;
  Histogram observed(20, 20);
  for_each_step(kernel, 1, [&](Displacement d) {
    const double r = std::hypot(d.x, d.y);
    observed.add(std::log(kernel.s2 / r) / std::log(kernel.s2 / kernel.s1), test::turns(d.x, d.y));
    EXPECT_GT(r, kernel.s1 * (1 - 1e-5));
    EXPECT_LT(r, kernel.s2 * (1 + 1e-5));
  });
  expect_uniform(observed);
}

class GaussianTest : public testing::TestWithParam<double> {};

// exp(-r^2 / (2 sigma^2)) and the angle are uniform: sigma per coordinate, coordinates independent.
TEST_P(GaussianTest, RadiusAndAngleFollowTheirLaw) {
  const double sigma = GetParam();
  Histogram observed(20, 20);
  for_each_step(gaussian(sigma), 2, [&](Displacement d) {
    const double r2 = (d.x * d.x + d.y * d.y) / (sigma * sigma);
    observed.add(std::exp(-0.5 * r2), test::turns(d.x, d.y));
  });
  expect_uniform(observed);
}

INSTANTIATE_TEST_SUITE_P(Sigmas, GaussianTest, testing::Values(0.05, 0.01, 0.002, 1e-4));

// A Gaussian wider than the torus wraps around it: the wrapped normal law of one coordinate.
TEST(Gaussian, WideStepsWrapAround) {
  constexpr double kSigma = 0.24;
  constexpr int kCells = 40;
  Histogram observed(kCells, 1), expected(kCells, 1);
  for_each_step(gaussian(kSigma), 3, [&](Displacement d) { observed.add(d.x + 0.5, 0); });
  const auto cdf = [](double x) { return 0.5 * std::erfc(-x / (kSigma * std::numbers::sqrt2)); };
  for (int i = 0; i < kCells; ++i) {
    double p = 0;
    for (int turn = -8; turn <= 8; ++turn) {
      const double low = static_cast<double>(i) / kCells - 0.5 + turn;
      p += cdf(low + 1.0 / kCells) - cdf(low);
    }
    expected.add_to(i, 0, p * kSteps);
  }
  EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), kFalseAlarm));
}

Kernel of_kind(KernelKind kind) {
  Kernel kernel;
  kernel.kind = kind;
  return kernel;
}

// A square of this half width holds most of a kernel's steps.
double reach_of(const Kernel& kernel) {
  switch (kernel.kind) {
    case KernelKind::kGaussian:
      return 3 * kernel.sigma;
    case KernelKind::kWrappedCauchy:
      return 5 * kernel.scale;
    case KernelKind::kUniform:
      return kernel.half_width;
    case KernelKind::kKelemenPair:
    case KernelKind::kKelemenCoordinate:
      break;
  }
  return kernel.s2;
}

// The share of a coordinate's steps that are at most d, of kernels whose coordinates are
// independent.
double share_below(const Kernel& k, double d) {
  if (k.kind == KernelKind::kUniform) return 0.5 + 0.5 * d / k.half_width;
  if (k.kind == KernelKind::kKelemenCoordinate) {
    const double length = std::clamp(std::fabs(d), k.s1, k.s2);
    const double share = 0.5 * std::log(length / k.s1) / std::log(k.s2 / k.s1);
    return d < 0 ? 0.5 - share : 0.5 + share;
  }
  return 0.5 + std::atan(std::tan(std::numbers::pi * d) / std::tanh(std::numbers::pi * k.scale)) /
                   std::numbers::pi;
}

class CoordinateTest : public testing::TestWithParam<Kernel> {};

// H0: each coordinate follows its law, and they are independent.
TEST_P(CoordinateTest, FollowsItsLaw) {
  const Kernel kernel = GetParam();
  Histogram observed(20, 20);
  for_each_step(kernel, 6, [&](Displacement d) {
    observed.add(share_below(kernel, d.x), share_below(kernel, d.y));
  });
  expect_uniform(observed);
}

INSTANTIATE_TEST_SUITE_P(Kernels, CoordinateTest,
                         testing::Values(of_kind(KernelKind::kKelemenCoordinate),
                                         of_kind(KernelKind::kWrappedCauchy),
                                         Kernel{.kind = KernelKind::kWrappedCauchy, .scale = 0.2},
                                         of_kind(KernelKind::kUniform)));

class SymmetryTest : public testing::TestWithParam<Kernel> {};

// H0: a displacement and its opposite are equally likely. Each of 200 half-plane cells against its
// opposite, binomial with p = 1/2: a sum of 200 squared z's.
TEST_P(SymmetryTest, OppositeStepsAreEquallyLikely) {
  const Kernel kernel = GetParam();
  const double reach = reach_of(kernel);
  Histogram cells(20, 20);
  for_each_step(kernel, 4, [&](Displacement d) {
    const double u = 0.5 + 0.5 * d.x / reach, v = 0.5 + 0.5 * d.y / reach;
    if (u >= 0 && u < 1 && v >= 0 && v < 1) cells.add(u, v);
  });
  double sum = 0;
  int degrees = 0;
  for (int i = 0; i < 200; ++i) {
    const double here = cells.counts()[i], opposite = cells.counts()[399 - i];
    if (here + opposite < 20) continue;
    sum += (here - opposite) * (here - opposite) / (here + opposite);
    ++degrees;
  }
  EXPECT_GT(degrees, 100);
  EXPECT_GT(test::chi_square_p(sum, degrees), kFalseAlarm);
}

// A step doesn't depend on where it starts: the torus has no border at 0 and 1.
TEST_P(SymmetryTest, StepsWrapExactly) {
  const Stepper stepper(GetParam());
  test::UniformLanes random(5);
  for (int i = 0; i < 1000; ++i) {
    const UInt w0 = random.word(), w1 = random.word();
    const FixedPair zero = stepper.step({UInt(0U), UInt(0U)}, w0, w1);
    for (uint32_t start : {0xffffffffU, 0x80000000U, 1U}) {
      const FixedPair there = stepper.step({UInt(start), UInt(start)}, w0, w1);
      for (int lane = 0; lane < kLanes; ++lane) {
        EXPECT_EQ(lane_word(there.first, lane) - start, lane_word(zero.first, lane));
        EXPECT_EQ(lane_word(there.second, lane) - start, lane_word(zero.second, lane));
      }
    }
  }
}

TEST_P(SymmetryTest, ExtremeWordsStayFinite) {
  const Stepper stepper(GetParam());
  for (uint32_t word : {0U, 0xffffffffU}) {
    const FixedPair to = stepper.step({UInt(0U), UInt(0U)}, UInt(word), UInt(word));
    // A wrapped Cauchy reaches all around the torus.
    const double most = GetParam().kind == KernelKind::kWrappedCauchy ? 0.5 : 0.49;
    EXPECT_LE(std::fabs(signed_turns(0, lane_word(to.first, 0))), most);
    EXPECT_LE(std::fabs(signed_turns(0, lane_word(to.second, 0))), most);
  }
}

// H0: steps follow the density that log_density() states where possible() says so: a cell's count
// per density is the same in all cells, as wide as 1/20 of the kernel's reach. The densities'
// midpoints stand for whole cells, so cells near their steep middles are left out.
TEST_P(SymmetryTest, StepsFollowTheDensity) {
  const Kernel kernel = GetParam();
  const Stepper stepper(kernel);
  const double reach = reach_of(kernel);
  constexpr int kSide = 40, kPoints = 8;
  Histogram observed(kSide, kSide);
  for_each_step(kernel, 7, [&](Displacement d) {
    const double u = 0.5 + 0.5 * d.x / reach, v = 0.5 + 0.5 * d.y / reach;
    if (u >= 0 && u < 1 && v >= 0 && v < 1) observed.add(u, v);
  });
  std::vector<double> counts, densities;
  double count_sum = 0, density_sum = 0;
  for (int x = 0; x < kSide; ++x) {
    for (int y = 0; y < kSide; ++y) {
      if (std::min(std::abs(2 * x - kSide + 1), std::abs(2 * y - kSide + 1)) < 6) continue;
      double density = 0;
      for (int i = 0; i < kPoints * kPoints; ++i) {
        const double u = (x + (i % kPoints + 0.5) / kPoints) / kSide;
        const double v = (y + (double(i / kPoints) + 0.5) / kPoints) / kSide;
        const metropolis::Displacement d{Float(float((2 * u - 1) * reach)),
                                         Float(float((2 * v - 1) * reach))};
        if (!test::lane_set(stepper.possible(d), 0)) continue;
        density += std::exp(double(lane_value(stepper.log_density(d), 0)));
      }
      counts.push_back(observed.counts()[size_t(y) * kSide + x]);
      densities.push_back(density);
      count_sum += counts.back();
      density_sum += density;
    }
  }
  EXPECT_GT(count_sum, 20000);
  for (double& d : densities) d *= count_sum / density_sum;
  EXPECT_TRUE(test::follows(counts, densities, kFalseAlarm));
}

INSTANTIATE_TEST_SUITE_P(Kernels, SymmetryTest,
                         testing::Values(Kernel{}, gaussian(0.02),
                                         of_kind(KernelKind::kKelemenCoordinate),
                                         of_kind(KernelKind::kWrappedCauchy),
                                         of_kind(KernelKind::kUniform)));

// A wide Gaussian's density is that of the torus: equal at both ends.
TEST(Gaussian, DensityWrapsAround) {
  constexpr double kSigma = 0.24;
  const Stepper stepper(gaussian(kSigma));
  const auto density = [&](float d) {
    return std::exp(double(lane_value(stepper.log_density({Float(d), Float(0.F)}), 0)));
  };
  for (float d : {0.F, 0.1F, 0.3F, 0.5F}) {
    double images = 0, middle = 0;
    for (int turn = -4; turn <= 4; ++turn) {
      images += std::exp(-0.5 * std::pow((d + turn) / kSigma, 2));
      middle += std::exp(-0.5 * std::pow(turn / kSigma, 2));
    }
    EXPECT_NEAR(density(d) / density(0), images / middle, 1e-5);
    EXPECT_FLOAT_EQ(density(d), density(-d));
  }
}

}  // namespace
}  // namespace metrofarm::metropolis
