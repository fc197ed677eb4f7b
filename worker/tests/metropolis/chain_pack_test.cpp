#include "metropolis/chain_pack.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>

#include "tests/metropolis/branching_target.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

using test::BranchingTarget;

const RngKey kKey = rng_key(99, RngDomain::kChain);
const Moves kPlain{Proposals{}};

Moves with_orbits() {
  Proposals proposals;
  proposals.delayed_rejection.move = SecondMove::kOrbital;
  proposals.delayed_rejection.after_large_steps = true;
  return Moves(proposals);
}
const Moves kOrbits = with_orbits();

void load(ChainPack& chains, BranchingTarget& target, const std::vector<test::ExactStart>& starts) {
  ChainPack::State state;
  for (int lane = 0; lane < kLanes; ++lane) {
    state.f[lane] = starts[lane].payload.f;
    target.set_current(lane, starts[lane].payload);
    chains.sample().restore(lane, starts[lane].pairs);
  }
  chains.set_state(state);
}

void move_state(const ChainPack& from, const BranchingTarget& from_target, ChainPack& to,
                BranchingTarget& to_target) {
  to.set_state(from.state());
  for (int lane = 0; lane < kLanes; ++lane) {
    to_target.set_current(lane, from_target.current(lane));
    to.sample().restore(lane, from.sample().stored(lane));
  }
}

// Weights of the chain layer by lane, recovered from the scales by which payloads are recorded.
struct WeightSums {
  std::array<double, kLanes> chain{}, large_f{};
  uint64_t large_records = 0;
};

WeightSums run_and_weigh(uint64_t iterations, double c, const Moves& moves, bool flush) {
  const Kernel kernel;
  BranchingTarget target(false);
  WeightSums sums;
  target.set_sink([&](const BranchingTarget::Record& r) {
    const double denominator = r.f + kernel.large_step_probability * c;
    if (r.layer == Layer::kChain) {
      sums.chain[r.lane] += r.scale * denominator;
    } else {
      sums.large_f[r.lane] += r.f;
      ++sums.large_records;
      EXPECT_NEAR(r.scale * denominator, kernel.large_step_probability, 1e-6);
    }
  });
  ChainPack chains({kKey, 8, moves, c}, target);
  load(chains, target, test::exact_starts(false, kLanes, 1));
  chains.advance(iterations);
  if (flush) chains.flush();
  for (int lane = 0; lane < kLanes; ++lane)
    EXPECT_NEAR(chains.large_step_sums()[lane].sum * c, sums.large_f[lane],
                1e-5 * sums.large_f[lane]);
  return sums;
}

TEST(ChainPack, WeightsOfTheChainLayerSumToTheIterations) {
  for (const Moves* moves : {&kPlain, &kOrbits}) {
    for (double c : {0.1, 0.7, 20.0}) {
      const WeightSums sums = run_and_weigh(3000, c, *moves, true);
      for (double w : sums.chain) EXPECT_NEAR(w, 3000, 3000 * 2e-6);
    }
  }
}

TEST(ChainPack, OnlyTheFlushCompletesTheLayer) {
  const WeightSums sums = run_and_weigh(3000, 0.7, kPlain, false);
  double missing = 0;
  for (double w : sums.chain) {
    EXPECT_LT(w, 3000 + 1e-2);
    EXPECT_GT(w, 3000 - 17);
    missing += 3000 - w;
  }
  EXPECT_GT(missing, 0.1);
}

// A peak that no proposal can leave: its weight is recorded in portions, and all of it.
class PeakTarget final : public Target {
 public:
  Float evaluate(primary_space::SampleSource& source, Which /*into*/, Mask lanes) override {
    source.pair(0, lanes);
    return Float(1e-7F);
  }
  void accept(Which, Mask) override {}
  void record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) override {
    if (layer != Layer::kChain || which != Which::kCurrent) return;
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!metrofarm::test::lane_set(lanes, lane)) continue;
      weight += lane_value(scale, lane) * 1.3;
      largest = std::max(largest, lane_value(scale, lane) * 1.3);
      serials[lane].insert({serial, 0}).first->second++;
    }
  }
  double weight = 0, largest = 0;
  std::array<std::map<uint64_t, int>, kLanes> serials;
};

TEST(ChainPack, AStuckChainRecordsItsWeightInPortions) {
  PeakTarget target;
  ChainPack chains({kKey, 0, kPlain, 1.0}, target);
  ChainPack::State state;
  std::fill(std::begin(state.f), std::end(state.f), 1.F);
  for (int lane = 0; lane < kLanes; ++lane) chains.sample().restore(lane, {{0, 1, 2}});
  chains.set_state(state);
  chains.advance(10000);
  chains.flush();
  EXPECT_NEAR(target.weight, 80000, 80000 * 1e-5);
  EXPECT_LT(target.largest, 18);
  for (const auto& lane : target.serials)
    for (const auto& [serial, count] : lane) EXPECT_EQ(count, 1) << serial;
}

class CutTest : public testing::TestWithParam<const Moves*> {};

TEST_P(CutTest, ChangesNoState) {
  const auto starts = test::exact_starts(false, kLanes, 2);
  const ChainPackConfig config{kKey, 16, *GetParam(), 0.7};
  BranchingTarget whole_target(false), part_target(false), rest_target(false);
  for (BranchingTarget* t : {&whole_target, &part_target, &rest_target})
    t->set_sink([](const BranchingTarget::Record&) {});
  ChainPack whole(config, whole_target), part(config, part_target), rest(config, rest_target);
  load(whole, whole_target, starts);
  whole.advance(100);
  load(part, part_target, starts);
  part.advance(37);
  part.flush();
  move_state(part, part_target, rest, rest_target);
  rest.advance(63);

  EXPECT_EQ(whole.state().iteration, rest.state().iteration);
  for (int lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(whole.state().f[lane], rest.state().f[lane]);
    EXPECT_EQ(whole.large_step_sums()[lane].sum, rest.large_step_sums()[lane].sum);
    EXPECT_EQ(whole.large_step_sums()[lane].count, rest.large_step_sums()[lane].count);
    EXPECT_EQ(whole_target.current(lane).x, rest_target.current(lane).x);
    const auto a = whole.sample().stored(lane), b = rest.sample().stored(lane);
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(a[i].slot, b[i].slot);
      EXPECT_EQ(a[i].first, b[i].first);
      EXPECT_EQ(a[i].second, b[i].second);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(PlainAndDelayed, CutTest, testing::Values(&kPlain, &kOrbits));

TEST(ChainPack, CountsAddUp) {
  BranchingTarget target(false);
  target.set_sink([](const BranchingTarget::Record&) {});
  ChainPack chains({kKey, 0, kOrbits, 0.7}, target);
  load(chains, target, test::exact_starts(false, kLanes, 3));
  chains.advance(5000);
  const ChainCounts c = chains.counts();
  EXPECT_EQ(c.mutations, 40000U);
  EXPECT_EQ(c.large.tried + c.small.tried, c.mutations);
  // What was rejected has a second stage, and each stage is one evaluation.
  EXPECT_EQ(c.second_after_small.tried, c.small.tried - c.small.accepted);
  EXPECT_EQ(c.second_after_large.tried, c.large.tried - c.large.accepted);
  EXPECT_EQ(c.evaluations, c.mutations + c.second_after_small.tried + c.second_after_large.tried);
  for (const Tries& t : {c.small, c.large, c.second_after_small, c.second_after_large}) {
    EXPECT_GT(t.accepted, 0U);
    EXPECT_LT(t.accepted, t.tried);
  }
  // Every evaluation reads the first pair, and none more than three.
  EXPECT_GT(c.pairs_read, c.evaluations);
  EXPECT_LT(c.pairs_read, 3 * c.evaluations);
  uint64_t larges = 0;
  for (const LargeStepSums& s : chains.large_step_sums()) larges += s.count;
  EXPECT_EQ(larges, c.large.tried);
  // H0: a step is large with probability 0.3; 5,000 independent coins of the pack, rate 1e-6.
  const double z = (double(c.large.tried) / kLanes - 1500) / std::sqrt(5000 * 0.3 * 0.7);
  EXPECT_GT(metrofarm::test::normal_p(z), 1e-6);
}

class FlatTarget final : public Target {
 public:
  Float evaluate(primary_space::SampleSource& source, Which /*into*/, Mask lanes) override {
    source.pair(0, lanes);
    return Float(1.F);
  }
  void accept(Which, Mask) override {}
  void record(Which, Layer, Float, Mask, uint64_t) override {}
};

// H0: under f = 1 a chain that starts at a uniform point is uniform after any number of small
// steps. 20,000 packs after 30 steps, 16 x 16 cells, rate 1e-5.
TEST(ChainPack, AFlatTargetStaysUniform) {
  FlatTarget target;
  Proposals proposals;
  proposals.kernel.large_step_probability = 1e-6;
  const Moves moves(proposals);
  metrofarm::test::UniformLanes random(17);
  metrofarm::test::Histogram observed(16, 16), expected(16, 16);
  constexpr int kPacks = 20000;
  for (uint32_t pack = 0; pack < kPacks; ++pack) {
    ChainPack chains({kKey, pack * kLanes, moves, 1.0}, target);
    const UInt first = random.word(), second = random.word();
    ChainPack::State state;
    for (int lane = 0; lane < kLanes; ++lane) {
      state.f[lane] = 1;
      chains.sample().restore(lane, {{0, lane_word(first, lane), lane_word(second, lane)}});
    }
    chains.set_state(state);
    chains.advance(30);
    for (int lane = 0; lane < kLanes; ++lane) {
      const auto at = chains.sample().stored(lane)[0];
      observed.add(at.first * 0x1p-32, at.second * 0x1p-32);
    }
  }
  for (int x = 0; x < 16; ++x)
    for (int y = 0; y < 16; ++y) expected.add_to(x, y, kPacks * kLanes / 256.0);
  EXPECT_TRUE(metrofarm::test::follows(observed.counts(), expected.counts(), 1e-5));
}

}  // namespace
}  // namespace metrofarm::metropolis
