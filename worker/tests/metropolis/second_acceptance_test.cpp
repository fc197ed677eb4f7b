// Delayed rejection in closed form, on a ring of a few states where every flux can be summed:
// detailed balance of each acceptance rule, and the weights' exact expectation.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "metropolis/acceptance.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::metropolis {
namespace {

constexpr int kStates = 7;
using PerState = std::array<double, kStates>;

// Narrow peaks beside nothing at all; states with f = 0 can be proposed, not left.
constexpr PerState kDensities[] = {
    {0.02, 1, 7.5, 0.4, 3, 0, 0.4}, {5, 0, 0, 5, 0.001, 4.9, 5.1}, {1, 2, 3, 4, 5, 6, 7}};

int ring(int i) {
  return ((i % kStates) + kStates) % kStates;
}

double first(double f_x, double f_y) {
  return lane_value(metropolis_acceptance(Float(float(f_x)), Float(float(f_y))), 0);
}
double second(double g_x, double g_z, double ratio = 1) {
  return lane_value(second_acceptance(Float(float(g_x)), Float(float(g_z)), Float(float(ratio))),
                    0);
}

// What leads from x by y to z.
struct Path {
  int x, y, z;
  double probability;  // of proposing y and, once y is rejected, z
  double acceptance;
};

// Every path of a chain in which both proposals are drawn; `visit` sees each once.
template <class Rule, class Visit>
void for_each_path(const PerState& f, const Rule& rule, const Visit& visit) {
  for (int x = 0; x < kStates; ++x) {
    if (f[x] == 0) continue;
    for (int y = 0; y < kStates; ++y)
      for (int z = 0; z < kStates; ++z)
        if (const Path p = rule(f, x, y, z); p.probability > 0) visit(p);
  }
}

// Probability of a step on the ring; symmetric, and zero beyond two.
double symmetric_step(int d) {
  constexpr double kSteps[] = {0.2, 0.3, 0.1};
  const int length = std::min(ring(d), ring(-d));
  return length < 3 ? kSteps[length] : 0;
}

// The pairwise orbit on a line: all that is left of a rotation is to stay or to mirror x at y.
Path orbital(const PerState& f, int x, int y, int z) {
  double angle = 0;
  if (z == x) angle += 0.3;
  if (z == ring(2 * y - x)) angle += 0.7;
  const double a2 = f[y] < f[x] ? second(f[x] - f[y], f[z] - f[y]) : 0;
  return {x, y, z, symmetric_step(y - x) * angle, a2};
}

// A second stage without symmetry of any kind; its probabilities over z sum to 1.
double lopsided(int x, int y, int z) {
  const auto share = [&](int to) { return 1 + (2 * x + 3 * y + to * to) % 5; };
  int total = 0;
  for (int to = 0; to < kStates; ++to) total += share(to);
  return double(share(z)) / total;
}
Path tierney_mira(const PerState& f, int x, int y, int z) {
  const double there = symmetric_step(y - x) * lopsided(x, y, z);
  const double back = symmetric_step(y - z) * lopsided(z, y, x);
  const double a2 = f[y] < f[x] && there > 0 ? second(f[x] - f[y], f[z] - f[y], back / there) : 0;
  return {x, y, z, there, a2};
}

Path green_mira(const PerState& f, int x, int y, int z) {
  const int reverse = ring(z - (y - x));
  const double a2 = f[y] < f[x] ? second(f[x] - f[y], f[z] - f[reverse]) : 0;
  return {x, y, z, symmetric_step(y - x) * symmetric_step(z - x), a2};
}

// The large step and the local one after it.
Path after_large(const PerState& f, int x, int y, int z) {
  const double a2 = f[y] < f[x] ? second(f[x] - f[y], f[z] - f[y]) : 0;
  return {x, y, z, symmetric_step(z - x) / kStates, a2};
}

using Rule = Path (*)(const PerState&, int, int, int);
constexpr Rule kRules[] = {orbital, tierney_mira, green_mira, after_large};

double flux(const PerState& f, const Path& p) {
  return f[p.x] * p.probability * (1 - first(f[p.x], f[p.y])) * p.acceptance;
}

// Largest difference between the fluxes of the second stage to and fro, over the larger.
double imbalance(const PerState& f, Rule rule) {
  std::array<PerState, kStates> total{};
  for_each_path(f, rule, [&](const Path& p) { total[p.x][p.z] += flux(f, p); });
  double worst = 0;
  for (int x = 0; x < kStates; ++x)
    for (int z = 0; z < x; ++z)
      if (const double larger = std::max(total[x][z], total[z][x]); larger > 0)
        worst = std::max(worst, std::fabs(total[x][z] - total[z][x]) / larger);
  return worst;
}

TEST(SecondAcceptance, KeepsDetailedBalanceUnderEveryRule) {
  for (const PerState& f : kDensities)
    for (int rule = 0; rule < 4; ++rule) EXPECT_LT(imbalance(f, kRules[rule]), 1e-5) << rule;
}

// Where z's kernel to y is left out of account, the balance is lost, by as much as the kernel's
// ratio: what problem_with() refuses.
TEST(SecondAcceptance, LosesBalanceWithoutTheKernelsRatio) {
  const Rule without = [](const PerState& f, int x, int y, int z) {
    Path p = tierney_mira(f, x, y, z);
    if (f[y] < f[x]) p.acceptance = second(f[x] - f[y], f[z] - f[y]);
    return p;
  };
  for (const PerState& f : kDensities) EXPECT_GT(imbalance(f, without), 0.3);
}

// What one iteration records in state s, on average over the target: exactly f(s), if a chain is in
// every state in proportion to f. A second-stage weight multiplied once more by 1 - a1 is off here.
TEST(ExpectedWeights, RecordTheTargetExactly) {
  for (const PerState& f : kDensities) {
    for (int rule = 0; rule < 4; ++rule) {
      PerState recorded{};
      for_each_path(f, kRules[rule], [&](const Path& p) {
        const double a1 = first(f[p.x], f[p.y]);
        const double reached = f[p.x] * p.probability;
        const auto add = [&](double probability, double a2) {
          const ExpectedWeights w = expected_weights(Float(float(a1)), Float(float(a2)));
          recorded[p.x] += reached * probability * lane_value(w.current, 0);
          recorded[p.y] += reached * probability * lane_value(w.first, 0);
          recorded[p.z] += reached * probability * lane_value(w.second, 0);
        };
        add(a1, 0);
        add(1 - a1, p.acceptance);
      });
      for (int s = 0; s < kStates; ++s)
        EXPECT_NEAR(recorded[s], f[s], 2e-5) << "rule " << rule << ", state " << s;
    }
  }
}

TEST(SecondAcceptance, FollowsItsFormula) {
  EXPECT_EQ(second(2, 0), 0);
  EXPECT_EQ(second(2, -1), 0);
  EXPECT_EQ(second(2, 2), 1);
  EXPECT_EQ(second(2, 3), 1);
  EXPECT_FLOAT_EQ(second(2, 0.5), 0.25);
  EXPECT_FLOAT_EQ(second(2, 0.5, 2), 0.5);
}

// Ratios that vanish or overflow are limits, not NaN.
TEST(SecondAcceptance, HasLimits) {
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(second(2, 1, infinity), 1);
  EXPECT_EQ(second(2, 0, infinity), 0);
  EXPECT_EQ(second(2, -1, infinity), 0);
  EXPECT_EQ(second(2, 1, 0), 0);
  EXPECT_EQ(second(1e-30, 1e-30), 1);
  EXPECT_EQ(second(1e30, 1e-30), 0);
}

}  // namespace
}  // namespace metrofarm::metropolis
