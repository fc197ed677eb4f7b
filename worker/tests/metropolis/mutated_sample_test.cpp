#include "metropolis/mutated_sample.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

using primary_space::Pair;
using primary_space::StoredPair;
using test::lanes_of;

const RngKey kKey = rng_key(7, RngDomain::kChain);

// Chains first .. first + 7 as the job's first pack.
PackMembers chains_from(uint32_t first) {
  std::array<uint32_t, kLanes> chains;
  std::iota(chains.begin(), chains.end(), first);
  return {chains, 0};
}

Moves moves_of(SecondMove move) {
  Proposals p;
  p.delayed_rejection.move = move;
  p.delayed_rejection.rule = AcceptanceRule::kTierneyMira;
  return Moves(p);
}
const Moves kOrbital = moves_of(SecondMove::kOrbital);
const Moves kLocal = moves_of(SecondMove::kLocal);

MutatedSample make(uint32_t first_chain = 0, const Moves& moves = kOrbital) {
  return {kKey, chains_from(first_chain), moves};
}

void run_iteration(MutatedSample& sample, uint64_t iteration, Mask large, Mask accepted) {
  sample.begin(iteration);
  sample.set_steps({.large = large});
  sample.pair(0, all_lanes());
  sample.pair(5, mask_from_bits(0x0f));
  sample.finish(accepted, no_lanes());
}

TEST(MutatedSample, KeepsExactlyThePairsThatTheAcceptedStateRead) {
  MutatedSample sample = make();
  run_iteration(sample, 0, all_lanes(), mask_from_bits(0b00010001));
  EXPECT_EQ(sample.stored(0).size(), 2U);
  EXPECT_EQ(sample.stored(1).size(), 0U);
  ASSERT_EQ(sample.stored(4).size(), 1U);
  EXPECT_EQ(sample.stored(4)[0].slot, 0);
  // The next state of lane 0 reads less: what it doesn't read is forgotten.
  sample.begin(1);
  sample.set_steps({});
  sample.pair(0, all_lanes());
  sample.finish(all_lanes(), no_lanes());
  EXPECT_EQ(sample.stored(0).size(), 1U);
}

TEST(MutatedSample, ARejectedProposalLeavesTheStateAlone) {
  MutatedSample sample = make();
  run_iteration(sample, 0, all_lanes(), all_lanes());
  const std::vector<StoredPair> before = sample.stored(2);
  run_iteration(sample, 1, no_lanes(), no_lanes());
  const std::vector<StoredPair> after = sample.stored(2);
  ASSERT_EQ(before.size(), after.size());
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(before[i].first, after[i].first);
    EXPECT_EQ(before[i].second, after[i].second);
  }
}

TEST(MutatedSample, AnswersTheSameHoweverOftenAndByWhomAsked) {
  MutatedSample sample = make();
  run_iteration(sample, 0, all_lanes(), all_lanes());
  sample.begin(1);
  sample.set_steps({.large = mask_from_bits(0x33)});
  const Pair one_lane = sample.pair(5, mask_from_bits(1));
  const Pair all = sample.pair(5, all_lanes());
  EXPECT_EQ(lanes_of(one_lane.first), lanes_of(all.first));
  EXPECT_EQ(lanes_of(one_lane.second), lanes_of(all.second));
}

TEST(MutatedSample, SmallStepsStayNearAndLargeStepsDoNot) {
  MutatedSample sample = make();
  run_iteration(sample, 0, all_lanes(), all_lanes());
  const auto before = sample.stored(0);
  sample.begin(1);
  sample.set_steps({});
  sample.pair(0, all_lanes());
  const auto proposed = sample.read_pairs(0);
  ASSERT_EQ(proposed.size(), 1U);
  const auto moved = static_cast<int32_t>(proposed[0].first - before[0].first);
  EXPECT_LE(std::abs(moved * 0x1p-32), Kernel{}.s2);
  EXPECT_NE(moved, 0);
}

// Whether two lists are the same slots and words.
bool alike(const std::vector<StoredPair>& a, const std::vector<StoredPair>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& p, const auto& q) {
    return p.slot == q.slot && p.first == q.first && p.second == q.second;
  });
}

// Slots 0 and 5 are known; y reads 0, 5 and 7, z reads 0 and 9.
MutatedSample in_second_stage(const Moves& moves) {
  MutatedSample sample = make(0, moves);
  run_iteration(sample, 0, all_lanes(), all_lanes());
  sample.begin(1);
  sample.set_steps({.large = mask_from_bits(0xf0)});
  for (int slot : {0, 5, 7}) sample.pair(slot, all_lanes());
  sample.enter(Stage::kSecond);
  for (int slot : {0, 9}) sample.pair(slot, mask_from_bits(0x3c));
  return sample;
}

TEST(MutatedSample, KeepsExactlyThePairsThatTheAcceptedStageRead) {
  MutatedSample sample = in_second_stage(kOrbital);
  std::vector<StoredPair> z[kLanes];
  for (int lane = 0; lane < kLanes; ++lane) z[lane] = sample.read_pairs(lane);
  EXPECT_TRUE(z[0].empty());
  ASSERT_EQ(z[3].size(), 2U);
  EXPECT_EQ(z[3][1].slot, 9);
  const std::vector<StoredPair> x = sample.stored(1);
  sample.finish(mask_from_bits(0x41), mask_from_bits(0x28));
  for (int lane : {3, 5}) EXPECT_TRUE(alike(sample.stored(lane), z[lane])) << lane;
  for (int lane : {0, 6}) EXPECT_EQ(sample.stored(lane).size(), 3U) << lane;
  EXPECT_TRUE(alike(sample.stored(1), x));
}

TEST(MutatedSample, AllStatesOfAPairExistAtOnce) {
  MutatedSample sample = in_second_stage(kLocal);
  const std::vector<StoredPair> x = sample.stored(2), z = sample.read_pairs(2);
  sample.enter(Stage::kFirst);
  const std::vector<StoredPair> y = sample.read_pairs(2);
  sample.enter(Stage::kReverse);
  sample.pair(0, all_lanes());
  const std::vector<StoredPair> reverse = sample.read_pairs(2);
  EXPECT_NE(y[0].first, z[0].first);
  EXPECT_NE(x[0].first, z[0].first);
  // z - (y - x), exactly.
  EXPECT_EQ(reverse[0].first, z[0].first - (y[0].first - x[0].first));
  EXPECT_EQ(reverse[0].second, z[0].second - (y[0].second - x[0].second));
}

// A pair is the same whichever stage asks for it first, and whoever has asked before.
TEST(MutatedSample, StagesDoNotDependOnTheOrderOfReads) {
  for (const Moves* moves : {&kOrbital, &kLocal}) {
    MutatedSample a = in_second_stage(*moves), b = make(0, *moves);
    run_iteration(b, 0, all_lanes(), all_lanes());
    b.begin(1);
    b.set_steps({.large = mask_from_bits(0xf0)});
    for (Stage stage : {Stage::kReverse, Stage::kSecond, Stage::kFirst}) {
      for (int slot : {9, 7, 5, 0}) {
        a.enter(stage);
        b.enter(stage);
        const Pair p = a.pair(slot, all_lanes()), q = b.pair(slot, all_lanes());
        EXPECT_EQ(lanes_of(p.first), lanes_of(q.first)) << slot;
        EXPECT_EQ(lanes_of(p.second), lanes_of(q.second)) << slot;
      }
    }
  }
}

TEST(MutatedSample, SecondStagesAreTimid) {
  MutatedSample sample = in_second_stage(kOrbital);
  const auto distance = [](uint32_t a, uint32_t b) {
    return std::fabs(static_cast<int32_t>(a - b) * 0x1p-32);
  };
  // After large steps within the local kernel's reach, after small ones on the orbit.
  const double local = Kernel{}.s2 * kOrbital.delayed_rejection().local_scale;
  for (int lane : {2, 3, 4, 5}) {
    const auto x = sample.stored(lane)[0], z = sample.read_pairs(lane)[0];
    EXPECT_NE(x.first, z.first);
    EXPECT_LE(distance(x.first, z.first), lane < 4 ? 2 * Kernel{}.s2 : local);
    EXPECT_LE(distance(x.second, z.second), lane < 4 ? 2 * Kernel{}.s2 : local);
  }
}

TEST(MutatedSample, CountsThePairsAskedFor) {
  MutatedSample sample = in_second_stage(kOrbital);
  EXPECT_EQ(sample.pairs_read(), 12U);
  sample.finish(no_lanes(), no_lanes());
  EXPECT_EQ(sample.pairs_read(), 12U + 24 + 8);
}

TEST(MutatedSample, AStateRestoredGoesOnAlike) {
  MutatedSample one = make(40);
  for (uint64_t i = 0; i < 20; ++i)
    run_iteration(one, i, mask_from_bits(static_cast<uint32_t>(i * 37)), mask_from_bits(0x5a));
  MutatedSample two = make(40);
  for (int lane = 0; lane < kLanes; ++lane) two.restore(lane, one.stored(lane));
  for (MutatedSample* s : {&one, &two}) {
    s->begin(20);
    s->set_steps({.large = mask_from_bits(0x0f)});
  }
  for (int slot : {0, 5, 9}) {
    const Pair a = one.pair(slot, all_lanes()), b = two.pair(slot, all_lanes());
    EXPECT_EQ(lanes_of(a.first), lanes_of(b.first)) << "slot " << slot;
    EXPECT_EQ(lanes_of(a.second), lanes_of(b.second)) << "slot " << slot;
  }
}

TEST(MutatedSample, ChainsDifferAndALaneDoesNotMatter) {
  MutatedSample a = make(0), b = make(3);
  for (MutatedSample* s : {&a, &b}) {
    s->begin(12345678901ULL);
    s->set_steps({.large = all_lanes()});
  }
  const auto from_a = lanes_of(a.pair(4, all_lanes()).first);
  const auto from_b = lanes_of(b.pair(4, all_lanes()).first);
  for (int lane = 0; lane < 5; ++lane) EXPECT_EQ(from_a[lane + 3], from_b[lane]);
  EXPECT_NE(from_a[0], from_a[1]);
}

// H0: coins and fresh pairs are uniform and independent of each other: the coin of the step against
// the acceptance coin, and that against a coordinate. 40,000 draws each of one lane after the
// other, rate 1e-5 each.
TEST(MutatedSample, CoinsAreUniformAndIndependent) {
  MutatedSample sample = make();
  test::Histogram coins(20, 20), against_pair(20, 20), technique(20, 20), expected(20, 20);
  constexpr int kIterations = 40000;
  for (int i = 0; i < kIterations; ++i) {
    const Coins c = sample.begin(i);
    sample.set_steps({.large = all_lanes()});
    const Pair p = sample.pair(0, all_lanes());
    const Pair t = sample.pair(primary_space::kTechniqueSlot, all_lanes());
    sample.finish(no_lanes(), no_lanes());
    const int lane = i % kLanes;
    coins.add(lane_value(c.step, lane), lane_value(c.acceptance, lane));
    against_pair.add(lane_value(c.acceptance, lane), lane_value(p.first, lane));
    technique.add(lane_value(t.first, lane), lane_value(t.second, lane));
  }
  for (int x = 0; x < 20; ++x)
    for (int y = 0; y < 20; ++y) expected.add_to(x, y, kIterations / 400.0);
  for (const test::Histogram& h : {coins, against_pair, technique})
    EXPECT_TRUE(test::follows(h.counts(), expected.counts(), 1e-5));
}

// The lanes of a pack take the same kind of step, and the same technique in large ones, whichever
// chains they run; all else is each chain's own.
TEST(MutatedSample, APackSharesCoinAndTechnique) {
  const PackMembers first = chains_from(0);
  PackMembers other = chains_from(40), elsewhere = chains_from(0);
  elsewhere.pack = 1;
  struct Drawn {
    std::array<float, kLanes> step, technique, film;
  };
  const auto draw = [](const PackMembers& members) {
    MutatedSample sample(kKey, members, kOrbital);
    const Coins coins = sample.begin(77);
    sample.set_steps({.large = all_lanes()});
    return Drawn{lanes_of(coins.step),
                 lanes_of(sample.pair(primary_space::kTechniqueSlot, all_lanes()).first),
                 lanes_of(sample.pair(primary_space::kFilmSlot, all_lanes()).first)};
  };
  const Drawn a = draw(first), b = draw(other), c = draw(elsewhere);
  for (int lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(a.step[lane], a.step[0]);
    EXPECT_EQ(a.technique[lane], a.technique[0]);
    EXPECT_NE(a.film[lane], b.film[lane]);
  }
  EXPECT_EQ(a.step, b.step);
  EXPECT_EQ(a.technique, b.technique);
  EXPECT_NE(a.step, c.step);
  EXPECT_NE(a.technique, c.technique);
  EXPECT_EQ(a.film, c.film);
  EXPECT_NE(a.film[0], a.film[1]);
}

// An eye step draws the eye's pairs anew and keeps every other bit, a light step the light's.
TEST(MutatedSample, SubpathStepsKeepTheOtherSubpath) {
  using primary_space::Decision;
  const Moves moves{Proposals{}};
  MutatedSample sample(rng_key(4, RngDomain::kChain), 8, moves);
  const std::vector<primary_space::Slot> eye = {primary_space::kFilmSlot, primary_space::kLensSlot,
                                                primary_space::eye_slot(0, Decision::kLightPoint),
                                                primary_space::eye_slot(3, Decision::kLobe)};
  const std::vector<primary_space::Slot> light = {
      primary_space::light_slot(0, Decision::kLight),
      primary_space::light_slot(2, Decision::kDirection)};
  const std::vector<primary_space::Slot> shared = {primary_space::kTimeSlot,
                                                   primary_space::kTechniqueSlot};
  std::vector<primary_space::StoredPair> start;
  for (const auto& slots : {eye, light, shared})
    for (primary_space::Slot slot : slots)
      start.push_back({slot, 1000U + static_cast<uint32_t>(slot), 77});
  const Mask eye_lanes = mask_from_bits(0x0f), light_lanes = mask_from_bits(0xf0);
  for (int lane = 0; lane < kLanes; ++lane) sample.restore(lane, start);
  sample.begin(5);
  sample.set_steps({.eye = eye_lanes, .light = light_lanes});
  const auto kept = [&](primary_space::Slot slot) {
    const primary_space::Pair p = sample.pair(slot, all_lanes());
    const primary_space::FixedPair x{UInt(1000U + static_cast<uint32_t>(slot)), UInt(77U)};
    return bits((p.first == x.to_float().first) & (p.second == x.to_float().second));
  };
  for (primary_space::Slot slot : eye) EXPECT_EQ(kept(slot), 0xf0U) << slot;
  for (primary_space::Slot slot : light) EXPECT_EQ(kept(slot), 0x0fU) << slot;
  for (primary_space::Slot slot : shared) EXPECT_EQ(kept(slot), 0xffU) << slot;
}

}  // namespace
}  // namespace metrofarm::metropolis
