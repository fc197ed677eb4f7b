#include "tests/support/statistics.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace metrofarm::test {
namespace {

TEST(Statistics, ChiSquareQuantilesAreThoseOfTheTables) {
  EXPECT_NEAR(chi_square_p(3.841459, 1), 0.05, 1e-6);
  EXPECT_NEAR(chi_square_p(18.307038, 10), 0.05, 1e-6);
  EXPECT_NEAR(chi_square_p(29.588298, 10), 0.001, 1e-7);
  EXPECT_NEAR(chi_square_p(124.342113, 100), 0.05, 1e-6);
  EXPECT_NEAR(chi_square_p(1143.917, 1000), 0.001, 2e-5);
}

TEST(Statistics, NormalTailsAreThoseOfTheTables) {
  EXPECT_NEAR(normal_p(1.959964), 0.05, 1e-7);
  EXPECT_NEAR(normal_p(-3.290527), 0.001, 1e-8);
}

TEST(Statistics, SidakKeepsTheRateOfTheFamily) {
  EXPECT_NEAR(1 - std::pow(1 - sidak(1e-4, 50), 50), 1e-4, 1e-12);
}

TEST(Statistics, ChiSquareRejectsAFewPercentAndAcceptsTheTruth) {
  std::mt19937_64 random(5);
  std::vector<double> fair(100, 0), skewed(100, 0);
  const std::vector<double> expected(100, 1000);
  std::uniform_real_distribution<double> uniform;
  for (int i = 0; i < 100000; ++i) {
    const double u = uniform(random);
    ++fair[static_cast<int>(u * 100)];
    ++skewed[static_cast<int>(std::pow(u, 1.03) * 100)];
  }
  EXPECT_TRUE(follows(fair, expected, 1e-4));
  EXPECT_FALSE(follows(skewed, expected, 1e-4));
}

TEST(Statistics, SmallCellsArePooledButStillCount) {
  const std::vector<double> expected = {1000, 0, 0, 1};
  EXPECT_TRUE(follows(std::vector<double>{1000, 0, 0, 1}, expected, 1e-4));
  EXPECT_EQ(chi_square(std::vector<double>{990, 10, 0, 1}, expected).degrees, 0);
  const std::vector<double> two = {500, 500, 0, 0.5};
  EXPECT_FALSE(follows(std::vector<double>{400, 400, 200, 0.5}, two, 1e-4));
}

TEST(Statistics, AMeanIsJudgedByItsStandardError) {
  Moments near, far;
  for (int i = 0; i < 1000; ++i) {
    near.add(i % 2 == 0 ? 0.9 : 1.1);
    far.add(i % 2 == 0 ? 0.95 : 1.15);
  }
  EXPECT_TRUE(has_mean(near, 1, 1e-4));
  EXPECT_FALSE(has_mean(far, 1, 1e-4));
  EXPECT_FALSE(same_mean(near, far, 1e-4));
  EXPECT_TRUE(same_mean(near, far, 1e-4, 0.06));
}

}  // namespace
}  // namespace metrofarm::test
