// What chains record near a ridge that is narrower than a step, where a wrong weight of the second
// stage does most harm: multiplied once more by 1 - a1, the peak comes out half a percent too dark
// and its flanks one or two percent too bright or too dark.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "metropolis/chain_pack.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

constexpr int kBins = 8;  // by distance from the ridge, each half a width; the last holds the rest

// f = 0.1 + exp(-t^2 / 2), t = (a - b) / kWidth on the torus.
class RidgeTarget final : public Target {
 public:
  static constexpr double kWidth = 0.012;
  static constexpr double kFloor = 0.1;

  static Float value(Float t) {
    return Float(static_cast<float>(kFloor)) + xsimd::exp(Float(-0.5F) * sqr(t));
  }
  static Float distance(const primary_space::Pair& p) {
    const Float d = p.first - p.second;
    return xsimd::abs(d - xsimd::nearbyint(d)) * Float(static_cast<float>(1 / kWidth));
  }

  Float evaluate(primary_space::SampleSource& source, Which into, Mask lanes) override {
    take(into, distance(source.pair(0, lanes)), lanes);
    return value(at(into));
  }
  void accept(Which from, Mask lanes) override { take(Which::kCurrent, at(from), lanes); }
  void record(Which which, Layer layer, Float scale, Mask lanes, uint64_t) override {
    if (layer != Layer::kChain || none(lanes)) return;
    const auto t = metrofarm::test::lanes_of(at(which));
    const auto splat = metrofarm::test::lanes_of(scale * value(at(which)));
    for (int lane = 0; lane < kLanes; ++lane)
      if (metrofarm::test::lane_set(lanes, lane)) sums[bin_of(t[lane])] += splat[lane];
  }
  // Counts the current states.
  void visit() {
    for (float t : metrofarm::test::lanes_of(at(Which::kCurrent))) ++visits[bin_of(t)];
  }
  void set_current(Float t) { take(Which::kCurrent, t, all_lanes()); }

  std::array<double, kBins> sums{}, visits{};

 private:
  static int bin_of(float t) { return std::min(static_cast<int>(2 * t), kBins - 1); }
  Float& at(Which which) { return distance_[static_cast<int>(which)]; }
  void take(Which into, Float t, Mask lanes) { at(into) = select(lanes, t, at(into)); }

  Float distance_[kStates] = {Float(0.F), Float(0.F), Float(0.F)};
};

// Integral of f over the points whose distance lies below t widths.
double integral_below(double t) {
  const double w = RidgeTarget::kWidth;
  return 2 * w *
         (RidgeTarget::kFloor * t +
          std::sqrt(std::numbers::pi / 2) * std::erf(t / std::numbers::sqrt2));
}

// Starts all lanes from f itself, by rejection.
void start(ChainPack& chains, RidgeTarget& target, metrofarm::test::UniformLanes& random) {
  UInt a(0U), b(0U);
  Mask open = all_lanes();
  while (any(open)) {
    const UInt first = random.word();
    const UInt second = random.word();
    const primary_space::Pair p = primary_space::FixedPair{first, second}.to_float();
    const Float f = RidgeTarget::value(RidgeTarget::distance(p));
    const Mask taken = open & (random.next() * Float(1.1F) < f);
    a = select(taken, first, a);
    b = select(taken, second, b);
    open = open & ~taken;
  }
  const Float t = RidgeTarget::distance(primary_space::FixedPair{a, b}.to_float());
  ChainPack::State state;
  RidgeTarget::value(t).store_aligned(state.f);
  for (int lane = 0; lane < kLanes; ++lane)
    chains.sample().restore(lane, {{0, lane_word(a, lane), lane_word(b, lane)}});
  target.set_current(t);
  chains.set_state(state);
}

struct Case {
  std::string name;
  SecondMove move;
  AcceptanceRule rule;
};
std::string name_of(const testing::TestParamInfo<Case>& param) {
  return param.param.name;
}
class RidgeTest : public testing::TestWithParam<Case> {};

// With c so small that a chain records its weights as they are. H0: each bin gathers its share of f
// in visits, and as much in recorded weights, which are their expected values; the difference of
// both varies far less than either. z-tests of 8 bins, twice, over 16,000 packs of 8 chains and 60
// steps, family rate 1e-5.
TEST_P(RidgeTest, SplatsFollowItsProfile) {
  Proposals proposals;
  proposals.kernel.large_step_probability = 0.02;
  proposals.kernel.s1 = 0.005;
  proposals.delayed_rejection.move = GetParam().move;
  proposals.delayed_rejection.rule = GetParam().rule;
  ASSERT_FALSE(problem_with(proposals));
  const Moves moves(proposals);
  const double all = integral_below(0.5 / RidgeTarget::kWidth);
  constexpr uint32_t kPacks = 16000;
  constexpr int kSteps = 60;
  metrofarm::test::UniformLanes random(61);
  RidgeTarget target;
  std::array<metrofarm::test::Moments, kBins> visits, differences;
  for (uint32_t pack = 0; pack < kPacks; ++pack) {
    ChainPack chains({rng_key(9, RngDomain::kChain), pack * kLanes, moves, 1e-9}, target);
    start(chains, target, random);
    target.sums = target.visits = {};
    for (int step = 0; step < kSteps; ++step) {
      chains.advance(1);
      target.visit();
    }
    chains.flush();
    for (int i = 0; i < kBins; ++i) {
      visits[i].add(target.visits[i] * all / (kSteps * kLanes));
      differences[i].add((target.sums[i] - target.visits[i]) * all / (kSteps * kLanes));
    }
  }
  const double rate = metrofarm::test::sidak(1e-5, 2 * kBins);
  for (int i = 0; i < kBins; ++i) {
    const double end = i + 1 == kBins ? 0.5 / RidgeTarget::kWidth : 0.5 * (i + 1);
    const double exact = integral_below(end) - integral_below(0.5 * i);
    EXPECT_TRUE(metrofarm::test::has_mean(visits[i], exact, rate)) << "bin " << i;
    EXPECT_TRUE(metrofarm::test::has_mean(differences[i], 0, rate))
        << "bin " << i << ": off by " << differences[i].mean() / exact << " +- "
        << differences[i].standard_error() / exact;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Rules, RidgeTest,
    testing::Values(Case{"Orbital", SecondMove::kOrbital, AcceptanceRule::kOrbital},
                    Case{"TierneyMira", SecondMove::kLocal, AcceptanceRule::kTierneyMira},
                    Case{"GreenMira", SecondMove::kLocal, AcceptanceRule::kGreenMira}),
    name_of);

}  // namespace
}  // namespace metrofarm::metropolis
