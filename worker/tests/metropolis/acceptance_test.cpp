#include "metropolis/acceptance.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/support/lane_tools.h"

namespace metrofarm::metropolis {
namespace {

// Detailed balance in closed form: five states, a symmetric proposal matrix, every flux both ways.
TEST(Acceptance, KeepsDetailedBalanceOnFiveStates) {
  constexpr std::array<float, 5> kDensity = {0.02F, 1.F, 7.5F, 0.4F, 3.F};
  constexpr double kProposal[5][5] = {{0.10, 0.30, 0.05, 0.25, 0.30},
                                      {0.30, 0.20, 0.25, 0.15, 0.10},
                                      {0.05, 0.25, 0.40, 0.10, 0.20},
                                      {0.25, 0.15, 0.10, 0.35, 0.15},
                                      {0.30, 0.10, 0.20, 0.15, 0.25}};
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 5; ++j) {
      const double to_j =
          lane_value(metropolis_acceptance(Float(kDensity[i]), Float(kDensity[j])), 0);
      const double to_i =
          lane_value(metropolis_acceptance(Float(kDensity[j]), Float(kDensity[i])), 0);
      EXPECT_NEAR(kDensity[i] * kProposal[i][j] * to_j, kDensity[j] * kProposal[j][i] * to_i, 1e-6);
      EXPECT_DOUBLE_EQ(std::max(to_i, to_j), 1);
    }
  }
}

TEST(Acceptance, ZeroIsNeverAccepted) {
  EXPECT_EQ(lane_value(metropolis_acceptance(Float(1e-30F), Float(0.F)), 0), 0.F);
  EXPECT_EQ(lane_value(metropolis_acceptance(Float(1e-30F), Float(1e30F)), 0), 1.F);
}

TEST(ExpectedWeights, SumToOne) {
  test::UniformLanes random(1);
  for (int i = 0; i < 1000; ++i) {
    const Float first = random.next(), second = random.next();
    const ExpectedWeights w = expected_weights(first, second);
    for (float sum : test::lanes_of(w.current + w.first + w.second)) EXPECT_NEAR(sum, 1, 1e-6);
  }
}

// m(f) F / f from the chain layer, developed as b A / N, and (1 - m(f)) F / c from the other,
// developed as c B / N_large: the two shares of a point make up F for every c.
TEST(LayerScales, SharesOfAPointMakeUpTheWhole) {
  for (float c : {1e-6F, 1.F, 1e6F}) {
    for (float f : {1e-9F, 0.3F, 1.F, 1e5F}) {
      const float p = 0.3F;
      const LayerScales scales{p * c, p};
      const double chain = double(f) * lane_value(scales.chain(Float(1.F), Float(f)), 0);
      const double large = double(c) * lane_value(scales.large_step(Float(f)), 0);
      EXPECT_NEAR(chain + large, 1, 1e-6) << "c = " << c << ", f = " << f;
    }
  }
}

// Kelemen's: both kinds of sample weigh by 1 / (f / c + p), and a state that a chain is in f / c of
// the time and large steps propose p of the time makes up the whole, if c is b.
TEST(LayerScales, KelemensSharesMakeUpTheWholeWithOneB) {
  for (float b : {1e-6F, 1.F, 1e6F}) {
    for (float f : {1e-3F, 0.3F, 1.F, 1e5F}) {
      const LayerScales scales{0.3F * b, 0.3F, LayerWeights::kKelemen};
      const double chain = lane_value(scales.chain(Float(1.F), Float(f)), 0) * double(f);
      const double large = lane_value(scales.large_step(Float(f)), 0) * 0.3 * b;
      EXPECT_NEAR(chain + large, 1, 1e-6) << "b = " << b << ", f = " << f;
    }
  }
}

TEST(LayerScales, StayBounded) {
  const LayerScales scales{0.3F, 0.3F};
  for (float f : {0.F, 1e-38F, 1.F, 3e38F}) {
    EXPECT_LE(f * lane_value(scales.chain(Float(1.F), Float(f)), 0), 1.0001F);
    EXPECT_LE(f * lane_value(scales.large_step(Float(f)), 0), 0.30001F);
  }
}

}  // namespace
}  // namespace metrofarm::metropolis
