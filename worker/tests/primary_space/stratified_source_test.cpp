#include "primary_space/stratified_source.h"

#include <gtest/gtest.h>

#include <set>

#include "math/sobol.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::primary_space {
namespace {

using test::lanes_of;

const RngKey kKey = rng_key(42, RngDomain::kBootstrap);

// The pairs of `slot` of the first `count` points of a sequence.
std::vector<std::array<float, 2>> points(Slot slot, uint64_t sequence, uint32_t count) {
  StratifiedSource source(kKey);
  std::vector<std::array<float, 2>> out;
  for (uint32_t i = 0; i < count; i += kLanes) {
    source.begin_points(i, sequence, i);
    const Pair p = source.pair(slot, all_lanes());
    for (int lane = 0; lane < kLanes; ++lane)
      out.push_back({lane_value(p.first, lane), lane_value(p.second, lane)});
  }
  return out;
}

// Against points 7, 14 and 55 of another implementation with Joe and Kuo's numbers (SciPy 1.14's
// qmc.Sobol, whose row i is point i ^ i >> 1), in 64ths.
TEST(Sobol, HasThePublishedDirectionNumbers) {
  const std::pair<uint32_t, std::array<int, kSobolDimensions>> known[] = {
      {7, {56, 56, 8, 24, 56, 40, 56, 24, 24, 8, 24, 56, 56, 8}},
      {14, {28, 36, 12, 44, 52, 4, 44, 44, 44, 4, 60, 20, 12, 12}},
      {55, {59, 41, 37, 59, 49, 19, 11, 51, 39, 11, 1, 5, 37, 55}}};
  for (const auto& [index, expected] : known) {
    for (int d = 0; d < kSobolDimensions; ++d) {
      const uint32_t word = sobol_detail::reverse_bits(sobol_reversed(index, d));
      EXPECT_EQ(word >> 26, static_cast<uint32_t>(expected[d]))
          << "point " << index << " dim " << d;
    }
  }
}

TEST(OwenScramble, KeepsWhoSharesWhichElementaryInterval) {
  const ScrambleKey key{UInt(0x9d2c5680U), UInt(0xefc60000U)};
  const uint32_t word = 0x5bd1e995U;
  const uint32_t scrambled = lane_word(owen_scramble(UInt(word), key), 0);
  for (int digit = 0; digit < 32; ++digit) {
    const uint32_t other = lane_word(owen_scramble(UInt(word ^ 1U << digit), key), 0);
    EXPECT_EQ(__builtin_clz(other ^ scrambled), digit);
  }
}

TEST(StratifiedSource, LeadingPairsAreNets) {
  for (Slot slot = 0; slot < kStratifiedSlots; ++slot) {
    for (uint64_t sequence : {uint64_t{0}, uint64_t{1}, uint64_t{1} << 40}) {
      std::set<int> first, second;
      for (const auto& p : points(slot, sequence, 64)) {
        first.insert(static_cast<int>(p[0] * 64));
        second.insert(static_cast<int>(p[1] * 64));
      }
      EXPECT_EQ(first.size(), 64U) << slot;
      EXPECT_EQ(second.size(), 64U) << slot;
    }
  }
}

TEST(StratifiedSource, TheFilmHasOnePointInEveryElementaryRectangle) {
  const auto film = points(kFilmSlot, 3, 256);
  for (int columns = 1; columns <= 256; columns *= 2) {
    std::set<std::pair<int, int>> cells;
    for (const auto& p : film)
      cells.insert({static_cast<int>(p[0] * columns), static_cast<int>(p[1] * (256 / columns))});
    EXPECT_EQ(cells.size(), 256U) << columns << " columns";
  }
}

// H0: one given point is uniform over the square, over scramblings. 80,000 sequences, 16 x 16
// cells, seven slots at a family rate of 1e-5.
TEST(StratifiedSource, EachPointIsUniform) {
  StratifiedSource source(kKey);
  for (Slot slot = 0; slot < kStratifiedSlots; ++slot) {
    test::Histogram observed(16, 16), expected(16, 16);
    for (uint64_t sequence = 0; sequence < 80000; sequence += kLanes) {
      source.begin_sequences(sequence, sequence, 5);
      const Pair p = source.pair(slot, all_lanes());
      for (int lane = 0; lane < kLanes; ++lane)
        observed.add(lane_value(p.first, lane), lane_value(p.second, lane));
    }
    for (int c = 0; c < 16; ++c)
      for (int r = 0; r < 16; ++r) expected.add_to(c, r, 80000 / 256.0);
    EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), test::sidak(1e-5, 7)));
  }
}

// H0: two points of one sequence, apart in index by more than a coarse interval, have independent
// fine digits: given their coarse digits, digits 5 to 8 of both are uniform on 16 x 16 cells. Seven
// slots, 80,000 sequences, family rate 1e-5. Digits that a scrambling shares between points would
// show here.
TEST(StratifiedSource, FineDigitsOfTwoPointsAreIndependent) {
  StratifiedSource source(kKey);
  for (Slot slot = 0; slot < kStratifiedSlots; ++slot) {
    test::Histogram observed(16, 16), expected(16, 16);
    for (uint64_t sequence = 0; sequence < 80000; sequence += kLanes) {
      const auto fine = [&](uint32_t index) {
        source.begin_sequences(sequence, sequence, index);
        return source.pair(slot, all_lanes()).first * Float(16.F);
      };
      const Float a = fine(0), b = fine(1);
      for (int lane = 0; lane < kLanes; ++lane) {
        const float x = lane_value(a, lane), y = lane_value(b, lane);
        observed.add(x - static_cast<int>(x), y - static_cast<int>(y));
      }
    }
    for (int c = 0; c < 16; ++c)
      for (int r = 0; r < 16; ++r) expected.add_to(c, r, 80000 / 256.0);
    EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), test::sidak(1e-5, 7))) << slot;
  }
}

TEST(StratifiedSource, BothWaysToAskGiveTheSamePoint) {
  StratifiedSource points(kKey), sequences(kKey);
  points.begin_points(800, 12, 40);
  sequences.begin_sequences(900, 10, 43);
  for (Slot slot = 0; slot < kStratifiedSlots; ++slot) {
    const Pair a = points.pair(slot, all_lanes());
    const Pair b = sequences.pair(slot, all_lanes());
    EXPECT_EQ(lane_value(a.first, 3), lane_value(b.first, 2));
    EXPECT_EQ(lane_value(a.second, 3), lane_value(b.second, 2));
  }
}

TEST(StratifiedSource, LaterPairsAreIndependent) {
  StratifiedSource source(kKey);
  IndependentSource plain(kKey);
  source.begin_points(64, 1, 32);
  plain.begin(64);
  for (Slot slot : {int{kStratifiedSlots}, kStratifiedSlots + 9}) {
    EXPECT_EQ(lanes_of(source.pair(slot, all_lanes()).first),
              lanes_of(plain.pair(slot, all_lanes()).first));
  }
}

TEST(StratifiedSource, ReadPairsReplayTheSample) {
  StratifiedSource source(kKey);
  source.begin_points(8, 0, 8);
  const Pair p = source.pair(kFilmSlot, all_lanes());
  const std::vector<StoredPair> read = source.read_pairs(6);
  ASSERT_EQ(read.size(), 1U);
  EXPECT_EQ(lane_value(unit_float(UInt(read[0].first)), 0), lane_value(p.first, 6));
  EXPECT_EQ(lane_value(unit_float(UInt(read[0].second)), 0), lane_value(p.second, 6));
}

}  // namespace
}  // namespace metrofarm::primary_space
