// Chains that start from the exact target distribution stay in it: after any number of steps every
// estimator must match the exact answer, whatever proposals, rule and weights are used.
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <string>
#include <vector>

#include "metropolis/chain_pack.h"
#include "tests/metropolis/branching_target.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

using metrofarm::test::Moments;
using test::BranchingTarget;

constexpr int kIterations = 10;
constexpr int kCells = BranchingTarget::kBins - 2;
constexpr double kFalseAlarm = 1e-5;

struct Case {
  std::string name;
  Proposals proposals;
  LayerWeights weights = LayerWeights::kTwoLayer;
  double factor = 1;  // c over b
  bool eager = false;
  uint32_t packs = 3000;
};

struct Outcome {
  std::vector<Moments> bins = std::vector<Moments>(BranchingTarget::kBins);
  Moments total;
  std::vector<double> states = std::vector<double>(BranchingTarget::kBins);  // at the end
  ChainCounts counts;
};

// The same for all runs: each is a test of its own.
const std::vector<test::ExactStart>& starts(bool eager, size_t count) {
  static std::map<bool, std::vector<test::ExactStart>> made;
  std::vector<test::ExactStart>& s = made[eager];
  if (s.size() < count) s = test::exact_starts(eager, count, 100);
  return s;
}

void load(ChainPack& chains, BranchingTarget& target, const test::ExactStart* starts) {
  ChainPack::State state;
  for (int lane = 0; lane < kLanes; ++lane) {
    state.f[lane] = starts[lane].payload.f;
    target.set_current(lane, starts[lane].payload);
    chains.sample().restore(lane, starts[lane].pairs);
  }
  chains.set_state(state);
}

// Per recorded scale times f, by layer.
std::array<double, 2> development(const Case& setup) {
  const double b = BranchingTarget::integral(), c = setup.factor * b;
  const double n = double{kIterations} * kLanes;
  if (setup.weights == LayerWeights::kKelemen) return {c / n, 0};
  return {b / n, c / (setup.proposals.kernel.large_step_probability * n)};
}

void count_states(const BranchingTarget& target, std::vector<double>& states) {
  for (int lane = 0; lane < kLanes; ++lane) {
    const BranchingTarget::Bins bins = BranchingTarget::bins_of(target.current(lane));
    ++states[bins.cell];
    if (bins.core >= 0) ++states[bins.core];
  }
}

// All layers developed and added, one independent estimate per pack.
Outcome run(const Case& setup, uint64_t seed) {
  const Moves moves(setup.proposals);
  const std::array<double, 2> develop = development(setup);
  const auto& from = starts(setup.eager, size_t{setup.packs} * kLanes);
  BranchingTarget target(setup.eager);
  Outcome out;
  std::vector<double> sums(BranchingTarget::kBins);
  target.set_sink([&](const BranchingTarget::Record& r) {
    const double v = develop[static_cast<int>(r.layer)] * r.scale * r.f;
    sums[r.bins.cell] += v;
    if (r.bins.core >= 0) sums[r.bins.core] += v;
  });
  for (uint32_t pack = 0; pack < setup.packs; ++pack) {
    std::fill(sums.begin(), sums.end(), 0.0);
    ChainPack chains({rng_key(seed, RngDomain::kChain), pack * kLanes, moves,
                      setup.factor * BranchingTarget::integral(), setup.weights},
                     target);
    load(chains, target, &from[size_t{pack} * kLanes]);
    chains.advance(kIterations);
    chains.flush();
    double total = 0;
    for (int i = 0; i < BranchingTarget::kBins; ++i) out.bins[i].add(sums[i]);
    for (int i = 0; i < kCells; ++i) total += sums[i];
    out.total.add(total);
    out.counts += chains.counts();
    count_states(target, out.states);
  }
  return out;
}

Proposals of_kernel(KernelKind kind) {
  Proposals p;
  p.kernel.kind = kind;
  p.kernel.sigma = 0.015;
  p.kernel.scale = 0.008;
  p.kernel.half_width = 0.02;
  return p;
}

const std::map<std::string, KernelKind> kKernels = {
    {"KelemenPair", KernelKind::kKelemenPair},
    {"Gaussian", KernelKind::kGaussian},
    {"KelemenCoordinate", KernelKind::kKelemenCoordinate},
    {"WrappedCauchy", KernelKind::kWrappedCauchy},
    {"Uniform", KernelKind::kUniform}};

struct Second {
  std::string name;
  SecondMove move;
  AcceptanceRule rule;
  AngleLaw law = AngleLaw::kWrappedCauchy;
  double concentration = DelayedRejection{}.concentration;
};
const std::vector<Second> kSeconds = {
    {"Alone", SecondMove::kNone, AcceptanceRule::kOrbital},
    {"Orbital", SecondMove::kOrbital, AcceptanceRule::kOrbital},
    {"VonMises", SecondMove::kOrbital, AcceptanceRule::kOrbital, AngleLaw::kVonMises, 2.5},
    {"OrbitalTierneyMira", SecondMove::kOrbital, AcceptanceRule::kTierneyMira},
    {"LocalTierneyMira", SecondMove::kLocal, AcceptanceRule::kTierneyMira},
    {"LocalGreenMira", SecondMove::kLocal, AcceptanceRule::kGreenMira}};

DelayedRejection delayed(const Second& second, bool after_large) {
  DelayedRejection d;
  d.move = second.move;
  d.rule = second.rule;
  d.angle_law = second.law;
  d.concentration = second.concentration;
  d.after_large_steps = after_large;
  return d;
}

// Every kernel with every second stage and rule that problem_with() allows.
std::vector<Case> all_allowed() {
  std::vector<Case> out;
  for (const auto& [name, kind] : kKernels) {
    for (const Second& second : kSeconds) {
      for (bool after_large : {false, true}) {
        for (LayerWeights weights : {LayerWeights::kTwoLayer, LayerWeights::kKelemen}) {
          Case s{name + second.name, of_kernel(kind), weights};
          s.proposals.delayed_rejection = delayed(second, after_large);
          if (after_large) s.name += "AfterLarge";
          s.name += weights == LayerWeights::kKelemen ? "OneLayer" : "TwoLayers";
          if (!problem_with(s.proposals)) out.push_back(s);
        }
      }
    }
  }
  return out;
}

// Two-layer weights with other constants, eager evaluation, frozen pairs, and more chains where a
// small bias would do most harm.
std::vector<Case> more() {
  std::vector<Case> out;
  for (const Second& second : kSeconds) {
    Case s{second.name, of_kernel(KernelKind::kKelemenPair)};
    s.proposals.delayed_rejection = delayed(second, true);
    for (double factor : {0.1, 3.0}) {
      s.factor = factor;
      s.name = second.name + (factor < 1 ? "SmallC" : "LargeC");
      out.push_back(s);
    }
    s.factor = 1;
    s.eager = true;
    s.name = second.name + "Eager";
    out.push_back(s);
    s.eager = false;
    s.name = second.name + "Frozen";
    s.proposals.frozen = {{test::kBranchingSlots[0], true, false},
                          {test::kBranchingSlots[1], true, true},
                          {test::kBranchingSlots[2], false, true}};
    out.push_back(s);
    s.name = second.name + "Subpaths";
    s.proposals.frozen = {};
    s.proposals.kernel.eye_step_probability = 0.25;
    s.proposals.kernel.light_step_probability = 0.2;
    out.push_back(s);
    s.name = second.name + "Long";
    s.proposals.kernel.eye_step_probability = s.proposals.kernel.light_step_probability = 0;
    s.proposals.kernel.large_step_probability = 0.1;
    s.packs = 24000;
    out.push_back(s);
  }
  return out;
}

class StationarityTest : public testing::TestWithParam<Case> {};

// H0 of the splats: the developed sum of every bin has the bin's integral as its mean; z-tests of
// 152 bins and of the total over `packs` independent packs of 80 iterations, family rate 1e-5. H0
// of the states: each chain ends in a cell with its share of the integral; chi-square over 150
// cells and z-tests of both cores, rates 1e-5.
TEST_P(StationarityTest, EveryBinMatchesTheExactAnswer) {
  ASSERT_FALSE(problem_with(GetParam().proposals));
  const Outcome out = run(GetParam(), 7);
  const std::vector<double>& exact = BranchingTarget::bin_integrals();
  const double b = BranchingTarget::integral();
  const double rate = metrofarm::test::sidak(kFalseAlarm, BranchingTarget::kBins + 1);
  const double chains = double{kLanes} * GetParam().packs;
  std::vector<double> expected;
  for (double integral : exact) expected.push_back(integral / b * chains);
  for (int i = 0; i < BranchingTarget::kBins; ++i)
    EXPECT_TRUE(metrofarm::test::has_mean(out.bins[i], exact[i], rate, 1e-9)) << "bin " << i;
  EXPECT_TRUE(metrofarm::test::has_mean(out.total, b, rate));
  const std::span<const double> states(out.states), shares(expected);
  EXPECT_TRUE(metrofarm::test::follows(states.first(kCells), shares.first(kCells), kFalseAlarm));
  for (int i = kCells; i < BranchingTarget::kBins; ++i) {
    const double p = expected[i] / chains;
    const double z = (out.states[i] - expected[i]) / std::sqrt(chains * p * (1 - p));
    EXPECT_GT(metrofarm::test::normal_p(z), kFalseAlarm) << "core " << i << ": z = " << z;
  }
}

std::string name_of(const testing::TestParamInfo<Case>& info) {
  return info.param.name;
}
INSTANTIATE_TEST_SUITE_P(Allowed, StationarityTest, testing::ValuesIn(all_allowed()), name_of);
INSTANTIATE_TEST_SUITE_P(More, StationarityTest, testing::ValuesIn(more()), name_of);

// H0: lazy and eager chains accept equally often in their stationary state, in both stages. About
// 0.9 million small and 0.4 million large steps each; the counts of a pack's neighbours are nearly
// independent, the binomial error is doubled for what correlation there is. Rate 1e-5 each.
TEST(Lazy, AcceptsAsOftenAsEager) {
  Case setup{"", of_kernel(KernelKind::kKelemenPair)};
  setup.proposals.delayed_rejection = delayed(kSeconds[1], true);
  setup.packs = 16000;
  const ChainCounts lazy = run(setup, 21).counts;
  setup.eager = true;
  const ChainCounts eager = run(setup, 22).counts;
  const auto p_value = [](const Tries& a, const Tries& b) {
    const double n = double(a.tried), m = double(b.tried);
    const double p = double(a.accepted + b.accepted) / (n + m);
    const double difference = double(a.accepted) / n - double(b.accepted) / m;
    return metrofarm::test::normal_p(0.5 * difference / std::sqrt(p * (1 - p) * (1 / n + 1 / m)));
  };
  EXPECT_GT(p_value(lazy.small, eager.small), 1e-5);
  EXPECT_GT(p_value(lazy.large, eager.large), 1e-5);
  EXPECT_GT(p_value(lazy.second_after_small, eager.second_after_small), 1e-5);
  EXPECT_GT(p_value(lazy.second_after_large, eager.second_after_large), 1e-5);
  EXPECT_LT(lazy.pairs_read, eager.pairs_read);
}

// Steps of each kind come as often as asked for, and no other step takes their second stage.
TEST(Subpaths, AreDrawnAsOftenAsAskedFor) {
  Case setup{"", of_kernel(KernelKind::kKelemenPair)};
  setup.proposals.delayed_rejection = delayed(kSeconds[1], false);
  setup.proposals.kernel.eye_step_probability = 0.25;
  setup.proposals.kernel.light_step_probability = 0.2;
  const ChainCounts c = run(setup, 23).counts;
  EXPECT_EQ(c.large.tried + c.small.tried + c.subpath.tried, c.mutations);
  EXPECT_EQ(c.second_after_small.tried, c.small.tried - c.small.accepted);
  // H0: binomial with p = 0.45, a coin for each pack and iteration; rate 1e-5.
  const double n = double(c.mutations) / kLanes, p = 0.45;
  EXPECT_GT(metrofarm::test::normal_p((double(c.subpath.tried) / kLanes - n * p) /
                                      std::sqrt(n * p * (1 - p))),
            1e-5);
  EXPECT_GT(c.subpath.accepted, c.subpath.tried / 10);
}

// The bins' integrals, which everything above relies on, against plain Monte Carlo: H0: their means
// agree. 800,000 samples, family rate 1e-5.
TEST(BranchingTarget, IntegralsAgreeWithMonteCarlo) {
  BranchingTarget target(false);
  primary_space::IndependentSource source(rng_key(5, RngDomain::kTest));
  std::vector<double> now(BranchingTarget::kBins);
  std::vector<Moments> bins(BranchingTarget::kBins);
  target.set_sink([&](const BranchingTarget::Record& r) {
    now[r.bins.cell] += r.f / kLanes;
    if (r.bins.core >= 0) now[r.bins.core] += r.f / kLanes;
  });
  for (uint64_t i = 0; i < 800000; i += kLanes) {
    source.begin(i);
    target.evaluate(source, Which::kProposal, all_lanes());
    std::fill(now.begin(), now.end(), 0.0);
    target.record(Which::kProposal, Layer::kLargeStep, Float(1.F), all_lanes(), 0);
    for (int k = 0; k < BranchingTarget::kBins; ++k) bins[k].add(now[k]);
  }
  const std::vector<double>& exact = BranchingTarget::bin_integrals();
  double sum = 0;
  for (int k = 0; k < BranchingTarget::kBins; ++k) {
    EXPECT_TRUE(metrofarm::test::has_mean(
        bins[k], exact[k], metrofarm::test::sidak(1e-5, BranchingTarget::kBins), 1e-9))
        << "bin " << k;
    if (k < BranchingTarget::kBins - 2) sum += exact[k];
  }
  EXPECT_NEAR(sum, BranchingTarget::integral(), 1e-6);
}

}  // namespace
}  // namespace metrofarm::metropolis
