// Proposals that read other pairs than the current state, all the time: stripes as narrow as a step
// decide whether a second pair is read. A ratio of densities over a set of pairs that is not the
// same seen from x and from z fails here.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "metropolis/chain_pack.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

// On even stripes of a, f = 1; on odd ones f = 0.2 + 4 ridge(c - d), with c and d of another pair.
class StripedTarget final : public Target {
 public:
  static constexpr int kStripes = 64;
  static constexpr double kWidth = 0.02;
  static constexpr double kLargest = 4.2;

  static Mask odd(Float a) {
    const Float t = a * Float(0.5F * kStripes);
    return t - xsimd::floor(t) >= Float(0.5F);
  }
  static Float height(Float distance) {
    const Float t = distance - xsimd::nearbyint(distance);
    return xsimd::exp(sqr(t * Float(static_cast<float>(1 / kWidth))) * Float(-0.5F));
  }

  Float evaluate(primary_space::SampleSource& source, Which /*into*/, Mask lanes) override {
    const Mask striped = lanes & odd(source.pair(0, lanes).first);
    if (none(striped)) return Float(1.F);
    const primary_space::Pair cd = source.pair(1, striped);
    const Float f = Float(0.2F) + Float(4.F) * height(cd.first - cd.second);
    return select(striped, f, Float(1.F));
  }
  void accept(Which, Mask) override {}
  void record(Which, Layer, Float, Mask, uint64_t) override {}

  // Integral of f over the odd stripes, as a share of all.
  static double odd_share() {
    const double striped = 0.2 + 4 * kWidth * std::sqrt(2 * std::numbers::pi);
    return striped / (striped + 1);
  }
};

// Exact draws, by rejection.
class Starts {
 public:
  explicit Starts(uint64_t seed) : random_(seed), source_(rng_key(seed, RngDomain::kTest)) {}

  // Starts one lane; returns f.
  float start(ChainPack& chains, int lane) {
    while (true) {
      if (lane_ == kLanes) refill();
      const int from = lane_++;
      const float f = lane_value(f_, from);
      if (lane_value(heights_, from) * StripedTarget::kLargest >= f) continue;
      chains.sample().restore(lane, source_.read_pairs(from));
      return f;
    }
  }

 private:
  void refill() {
    source_.begin(next_);
    next_ += kLanes;
    f_ = target_.evaluate(source_, Which::kProposal, all_lanes());
    heights_ = random_.next();
    lane_ = 0;
  }

  metrofarm::test::UniformLanes random_;
  primary_space::IndependentSource source_;
  StripedTarget target_;
  uint64_t next_ = 0;
  int lane_ = kLanes;
  Float f_ = Float(0.F), heights_ = Float(0.F);
};

struct Case {
  std::string name;
  KernelKind kernel;
  SecondMove move;
  AcceptanceRule rule;
};
std::string name_of(const testing::TestParamInfo<Case>& param) {
  return param.param.name;
}
class StripesTest : public testing::TestWithParam<Case> {};

// H0: after 20 steps from the exact distribution a chain is on an odd stripe as often as f says;
// z-test over 96,000 independent chains, rate 1e-5.
TEST_P(StripesTest, AreVisitedInProportion) {
  Proposals proposals;
  proposals.kernel.kind = GetParam().kernel;
  proposals.kernel.large_step_probability = 0.01;
  proposals.kernel.sigma = proposals.kernel.half_width = 0.02;
  proposals.delayed_rejection.move = GetParam().move;
  proposals.delayed_rejection.rule = GetParam().rule;
  proposals.delayed_rejection.local_scale = 1;
  ASSERT_FALSE(problem_with(proposals));
  const Moves moves(proposals);
  constexpr uint32_t kPacks = 12000;
  Starts starts(51);
  StripedTarget target;
  double odd = 0;
  for (uint32_t pack = 0; pack < kPacks; ++pack) {
    ChainPack chains({rng_key(8, RngDomain::kChain), pack * kLanes, moves}, target);
    ChainPack::State state;
    for (int lane = 0; lane < kLanes; ++lane) state.f[lane] = starts.start(chains, lane);
    chains.set_state(state);
    chains.advance(20);
    // On an odd stripe the second pair has been read.
    for (int lane = 0; lane < kLanes; ++lane)
      odd += double(chains.sample().stored(lane).size()) - 1;
  }
  const double n = double{kPacks} * kLanes, p = StripedTarget::odd_share();
  const double z = (odd - n * p) / std::sqrt(n * p * (1 - p));
  EXPECT_GT(metrofarm::test::normal_p(z), 1e-5) << "share " << odd / n << ", not " << p;
}

INSTANTIATE_TEST_SUITE_P(Rules, StripesTest,
                         testing::Values(Case{"Alone", KernelKind::kKelemenPair, SecondMove::kNone,
                                              AcceptanceRule::kOrbital},
                                         Case{"Orbital", KernelKind::kGaussian,
                                              SecondMove::kOrbital, AcceptanceRule::kOrbital},
                                         Case{"OrbitalUniform", KernelKind::kUniform,
                                              SecondMove::kOrbital, AcceptanceRule::kTierneyMira},
                                         Case{"LocalUniform", KernelKind::kUniform,
                                              SecondMove::kLocal, AcceptanceRule::kTierneyMira},
                                         Case{"LocalGaussian", KernelKind::kGaussian,
                                              SecondMove::kLocal, AcceptanceRule::kTierneyMira},
                                         Case{"LocalCauchy", KernelKind::kWrappedCauchy,
                                              SecondMove::kLocal, AcceptanceRule::kTierneyMira},
                                         Case{"GreenMira", KernelKind::kGaussian,
                                              SecondMove::kLocal, AcceptanceRule::kGreenMira}),
                         name_of);

}  // namespace
}  // namespace metrofarm::metropolis
