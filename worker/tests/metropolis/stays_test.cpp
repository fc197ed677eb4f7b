// Stays, and the alarm for chains that are trapped, on targets of which the answer is known.
#include "metropolis/stays.h"

#include <gtest/gtest.h>

#include "metropolis/chain_pack.h"

namespace metrofarm::metropolis {
namespace {

// f is 1, and in a corner of the first pair's square far more.
class SpikeTarget final : public Target {
 public:
  SpikeTarget(float side, float height) : side_(side), height_(height) {}

  Float evaluate(primary_space::SampleSource& source, Which /*into*/, Mask lanes) override {
    const primary_space::Pair u = source.pair(primary_space::kFilmSlot, lanes);
    const Mask inside = (u.first < Float(side_)) & (u.second < Float(side_));
    return select(inside, Float(height_), Float(1.F));
  }
  void accept(Which /*from*/, Mask /*lanes*/) override {}
  void record(Which /*which*/, Layer /*layer*/, Float /*scale*/, Mask /*lanes*/,
              uint64_t /*serial*/) override {}

 private:
  float side_, height_;
};

// Eight chains, the first of which starts in the corner, where f is `first_f`.
void start(ChainPack& chains, float first_f) {
  ChainPack::State state;
  for (int lane = 0; lane < kLanes; ++lane) {
    state.f[lane] = lane == 0 ? first_f : 1.F;
    const uint32_t at = lane == 0 ? 1U << 10 : 1U << 31;
    chains.sample().restore(lane, {{primary_space::kFilmSlot, at, at}});
  }
  chains.set_state(state);
}

const RngKey kKey = rng_key(5, RngDomain::kChain);
const Moves kMoves{Proposals{}};

// The corner is smaller than the smallest step and 1e7 times as bright: its chain leaves it, or one
// of the seven others enters it, in less than one of 2000 such runs.
TEST(TrappedChains, AreFoundInASpike) {
  SpikeTarget target(1e-4F, 1e7F);
  ChainPack chains({kKey, 0, kMoves}, target);
  start(chains, 1e7F);
  chains.advance(kTrappedAfter + 500);
  const StayCounts counts = chains.counts().stays;
  EXPECT_EQ(counts.trapped, 1U);
  EXPECT_EQ(counts.freed, 0U);
  EXPECT_EQ(counts.longest, uint64_t{kTrappedAfter} + 500);
}

TEST(TrappedChains, AreNotFoundWithoutASpike) {
  SpikeTarget target(0.3F, 20);
  ChainPack chains({kKey, 0, kMoves}, target);
  start(chains, 20);
  chains.advance(20000);
  const StayCounts counts = chains.counts().stays;
  EXPECT_EQ(counts.trapped, 0U);
  EXPECT_EQ(counts.freed, 0U);
  // A mutation moves with more than one half, wherever a chain is.
  EXPECT_GT(counts.longest, 2U);
  EXPECT_LT(counts.longest, 100U);
}

TEST(TrappedChains, AStayGoesOnInTheNextSegment) {
  SpikeTarget target(1e-6F, 1e7F);
  ChainPack first({kKey, 0, kMoves}, target);
  start(first, 1e7F);
  first.advance(kTrappedAfter - 1);
  EXPECT_EQ(first.counts().stays.trapped, 0U);

  ChainPack second({kKey, 0, kMoves}, target);
  second.set_state(first.state());
  for (int lane = 0; lane < kLanes; ++lane)
    second.sample().restore(lane, first.sample().stored(lane));
  second.advance(1);
  EXPECT_EQ(second.counts().stays.trapped, 1U);
  EXPECT_EQ(second.counts().stays.longest, uint64_t{kTrappedAfter});
}

TEST(Stays, CountMutationsWithoutAMove) {
  Stays stays;
  stays.set_lengths({0, 5, kTrappedAfter - 1, kTrappedAfter, kTrappedAfter + 7, 2147483647, 0, 0});
  const Mask moved = mask_from_bits(0b01010010);
  stays.observe(moved);
  const Stays::Lengths after = {1, 0, kTrappedAfter, kTrappedAfter + 1, 0, 2147483647, 0, 1};
  EXPECT_EQ(stays.lengths(), after);
  const StayCounts counts = stays.counts();
  EXPECT_EQ(counts.trapped, 1U);
  EXPECT_EQ(counts.freed, 1U);
  EXPECT_EQ(counts.longest, 2147483647U);
}

TEST(Stays, OfSeveralSegmentsTheLongestCounts) {
  StayCounts sum{10, 1, 0};
  sum += {7, 2, 1};
  EXPECT_EQ(sum.longest, 10U);
  EXPECT_EQ(sum.trapped, 3U);
  EXPECT_EQ(sum.freed, 1U);
}

}  // namespace
}  // namespace metrofarm::metropolis
