#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "primary_space/sample_source.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::primary_space {
namespace {

using test::lanes_of;

const RngKey kKey = rng_key(42, RngDomain::kBootstrap);

TEST(IndependentSource, ASampleDoesNotDependOnItsLane) {
  IndependentSource a(kKey), b(kKey);
  a.begin(16);
  b.begin(13);
  for (Slot slot : {0, 5, 700}) {
    const Pair pa = a.pair(slot, all_lanes()), pb = b.pair(slot, all_lanes());
    for (int lane = 0; lane < 5; ++lane) {
      EXPECT_EQ(lane_value(pa.first, lane), lane_value(pb.first, lane + 3));
      EXPECT_EQ(lane_value(pa.second, lane), lane_value(pb.second, lane + 3));
    }
  }
}

TEST(IndependentSource, AnswersTheSameHoweverOftenAsked) {
  IndependentSource source(kKey);
  source.begin(0);
  const Pair once = source.pair(3, mask_from_bits(1));
  source.pair(1, all_lanes());
  const Pair again = source.pair(3, all_lanes());
  EXPECT_EQ(lanes_of(once.first), lanes_of(again.first));
  EXPECT_EQ(lanes_of(once.second), lanes_of(again.second));
}

TEST(IndependentSource, ReadPairsAreExactlyWhatALaneHasRead) {
  IndependentSource source(kKey);
  source.begin(8);
  const Pair p = source.pair(9, mask_from_bits(0b0110));
  source.pair(2, mask_from_bits(0b0100));
  EXPECT_TRUE(source.read_pairs(0).empty());
  ASSERT_EQ(source.read_pairs(1).size(), 1U);
  const std::vector<StoredPair> read = source.read_pairs(2);
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0].slot, 2);
  EXPECT_EQ(read[1].slot, 9);
  EXPECT_EQ(lane_value(unit_float(UInt(read[1].first)), 0), lane_value(p.first, 2));
  EXPECT_EQ(lane_value(unit_float(UInt(read[1].second)), 0), lane_value(p.second, 2));
  source.begin(16);
  EXPECT_TRUE(source.read_pairs(2).empty());
}

TEST(IndependentSource, IndicesBeyond32BitsAreOtherSamples) {
  IndependentSource source(kKey);
  std::set<float> seen;
  for (uint64_t first :
       {uint64_t{0}, uint64_t{1} << 32, (uint64_t{1} << 32) - 8, uint64_t{5} << 40}) {
    source.begin(first);
    for (float v : lanes_of(source.pair(0, all_lanes()).first)) seen.insert(v);
  }
  EXPECT_EQ(seen.size(), 32U);
  // A pack may straddle the word boundary.
  source.begin((uint64_t{1} << 32) - 4);
  const auto straddling = lanes_of(source.pair(0, all_lanes()).first);
  source.begin(uint64_t{1} << 32);
  EXPECT_EQ(straddling[4], lanes_of(source.pair(0, all_lanes()).first)[0]);
}

// H0: pairs are uniform and independent over the square. 160,000 pairs per slot, 32 x 32 cells,
// four slots at a family rate of 1e-5.
TEST(IndependentSource, PairsAreUniform) {
  IndependentSource source(kKey);
  for (Slot slot : {0, 3, 4, 2050}) {
    test::Histogram observed(32, 32), expected(32, 32);
    for (uint64_t i = 0; i < 160000; i += kLanes) {
      source.begin(i);
      const Pair p = source.pair(slot, all_lanes());
      for (int lane = 0; lane < kLanes; ++lane)
        observed.add(lane_value(p.first, lane), lane_value(p.second, lane));
    }
    for (int c = 0; c < 32; ++c)
      for (int r = 0; r < 32; ++r) expected.add_to(c, r, 160000 / 1024.0);
    EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), test::sidak(1e-5, 4)));
  }
}

TEST(Slots, EverySlotHasOneMeaning) {
  std::set<Slot> slots = {kFilmSlot, kLensSlot, kTimeSlot};
  for (int vertex = 0; vertex < kLongestPath; ++vertex) {
    for (Decision d :
         {Decision::kLobe, Decision::kDirection, Decision::kLight, Decision::kLightPoint}) {
      slots.insert(eye_slot(vertex, d));
      slots.insert(light_slot(vertex, d));
    }
  }
  EXPECT_EQ(slots.size(), static_cast<size_t>(kSlotCount));
  EXPECT_EQ(*slots.rbegin(), kSlotCount - 1);
}

}  // namespace
}  // namespace metrofarm::primary_space
