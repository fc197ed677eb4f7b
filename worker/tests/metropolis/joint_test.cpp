// Geweke 2004, "Getting It Right": a parameter and a state, drawn jointly in two ways. Drawn one
// after the other from the prior, their law is known. Drawn in turn, the state by one iteration of
// the chains under the parameter and the parameter given the state, they must keep it.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "metropolis/chain_pack.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

constexpr int kOffsets = 8;
constexpr double kFalseAlarm = 1e-5;

// A ridge whose place is the parameter: f = 0.15 + exp(-(t / width)^2 / 2), where t is the distance
// of a - b from offset / 8 on the torus. Its integral is the same for every offset.
class MovingRidge final : public Target {
 public:
  static constexpr double kWidth = 0.02;

  std::array<int, kLanes> offset{};

  static float density(float a, float b, int offset) {
    const double t = std::remainder(double(a) - double(b) - double(offset) / kOffsets, 1.0);
    return static_cast<float>(0.15 + std::exp(-0.5 * t * t / (kWidth * kWidth)));
  }

  Float evaluate(primary_space::SampleSource& source, Which /*into*/, Mask lanes) override {
    const primary_space::Pair p = source.pair(0, lanes);
    metrofarm::test::Lanes f{};
    for (int lane = 0; lane < kLanes; ++lane)
      f[lane] = density(lane_value(p.first, lane), lane_value(p.second, lane), offset[lane]);
    return metrofarm::test::from_lanes(f);
  }
  void accept(Which, Mask) override {}
  void record(Which, Layer, Float, Mask, uint64_t) override {}
};

struct Point {
  float a, b;
};

Point point_of(const ChainPack& chains, int lane) {
  const auto at = chains.sample().stored(lane)[0];
  return {lane_value(unit_float(UInt(at.first)), 0), lane_value(unit_float(UInt(at.second)), 0)};
}

// The parameter given the state: in proportion to f, by inversion of u.
int draw_offset(const Point& p, double u) {
  std::array<double, kOffsets> f;
  double total = 0;
  for (int i = 0; i < kOffsets; ++i) total += f[i] = MovingRidge::density(p.a, p.b, i);
  for (int i = 0; i + 1 < kOffsets; ++i)
    if ((u -= f[i] / total) < 0) return i;
  return kOffsets - 1;
}

// Statistics of the joint law whose means are known by symmetry, or by one integral.
constexpr int kStatistics = 6;
std::array<double, kStatistics> statistics(const Point& p, int offset) {
  const double turn = 2 * std::numbers::pi;
  const double t = std::remainder(double(p.a) - p.b - double(offset) / kOffsets, 1.0);
  return {std::cos(turn * p.a),
          std::cos(turn * p.b),
          offset - 0.5 * (kOffsets - 1),
          std::fabs(t) < MovingRidge::kWidth ? 1.0 : 0.0,
          std::sin(turn * t),
          std::cos(turn * (p.a + p.b)) * (offset % 2 == 0 ? 1 : -1)};
}

double share_on_the_ridge() {
  const double w = MovingRidge::kWidth, s = w * std::sqrt(2 * std::numbers::pi);
  return (0.15 * 2 * w + s * std::erf(1 / std::numbers::sqrt2)) / (0.15 + s);
}

// Starts every lane from the joint law: the parameter from its prior, the state by rejection.
void start(ChainPack& chains, MovingRidge& target, metrofarm::test::UniformLanes& random) {
  for (int lane = 0; lane < kLanes; ++lane) {
    target.offset[lane] = static_cast<int>(lane_value(random.next(), 0) * kOffsets);
    while (true) {
      const UInt words[2] = {random.word(), random.word()};
      const uint32_t a = lane_word(words[0], 0), b = lane_word(words[1], 0);
      chains.sample().restore(lane, {{0, a, b}});
      const Point p = point_of(chains, lane);
      if (lane_value(random.next(), 0) * 1.15 < MovingRidge::density(p.a, p.b, target.offset[lane]))
        break;
    }
  }
}

// One turn of the successive simulator; adds the lanes' statistics.
void turn(ChainPack& chains, MovingRidge& target, metrofarm::test::UniformLanes& random,
          std::array<double, kStatistics>& sums) {
  ChainPack::State state = chains.state();
  for (int lane = 0; lane < kLanes; ++lane) {
    const Point p = point_of(chains, lane);
    state.f[lane] = MovingRidge::density(p.a, p.b, target.offset[lane]);
  }
  chains.set_state(state);
  chains.advance(1);
  const metrofarm::test::Lanes coins = metrofarm::test::lanes_of(random.next());
  for (int lane = 0; lane < kLanes; ++lane) {
    const Point p = point_of(chains, lane);
    target.offset[lane] = draw_offset(p, coins[lane]);
    const auto now = statistics(p, target.offset[lane]);
    for (int i = 0; i < kStatistics; ++i) sums[i] += now[i];
  }
}

struct Case {
  std::string name;
  KernelKind kernel;
  SecondMove move;
  AcceptanceRule rule;
};
std::string name_of(const testing::TestParamInfo<Case>& param) {
  return param.param.name;
}
class JointTest : public testing::TestWithParam<Case> {};

// H0: the successive simulator keeps the joint law, so each statistic has its known mean. z-tests
// over 1,000 independent packs of 8 chains and 30 turns, family rate 1e-5.
TEST_P(JointTest, SuccessiveDrawsKeepTheJointLaw) {
  Proposals proposals;
  proposals.kernel.kind = GetParam().kernel;
  proposals.kernel.large_step_probability = 0.02;
  proposals.delayed_rejection.move = GetParam().move;
  proposals.delayed_rejection.rule = GetParam().rule;
  proposals.delayed_rejection.after_large_steps = true;
  ASSERT_FALSE(problem_with(proposals));
  const Moves moves(proposals);
  MovingRidge target;
  metrofarm::test::UniformLanes random(41);
  std::array<metrofarm::test::Moments, kStatistics> means;
  for (uint32_t pack = 0; pack < 1000; ++pack) {
    ChainPack chains({rng_key(6, RngDomain::kChain), pack * kLanes, moves}, target);
    start(chains, target, random);
    std::array<double, kStatistics> sums{};
    for (int i = 0; i < 30; ++i) turn(chains, target, random, sums);
    for (int i = 0; i < kStatistics; ++i) means[i].add(sums[i] / (30 * kLanes));
  }
  const double rate = metrofarm::test::sidak(kFalseAlarm, kStatistics);
  const double expected[kStatistics] = {0, 0, 0, share_on_the_ridge(), 0, 0};
  for (int i = 0; i < kStatistics; ++i)
    EXPECT_TRUE(metrofarm::test::has_mean(means[i], expected[i], rate)) << "statistic " << i;
}

INSTANTIATE_TEST_SUITE_P(Rules, JointTest,
                         testing::Values(Case{"Alone", KernelKind::kKelemenPair, SecondMove::kNone,
                                              AcceptanceRule::kOrbital},
                                         Case{"Orbital", KernelKind::kKelemenPair,
                                              SecondMove::kOrbital, AcceptanceRule::kOrbital},
                                         Case{"OrbitalTierneyMira", KernelKind::kWrappedCauchy,
                                              SecondMove::kOrbital, AcceptanceRule::kTierneyMira},
                                         Case{"LocalTierneyMira", KernelKind::kKelemenCoordinate,
                                              SecondMove::kLocal, AcceptanceRule::kTierneyMira},
                                         Case{"LocalGreenMira", KernelKind::kGaussian,
                                              SecondMove::kLocal, AcceptanceRule::kGreenMira}),
                         name_of);

}  // namespace
}  // namespace metrofarm::metropolis
