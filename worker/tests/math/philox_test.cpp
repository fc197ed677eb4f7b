#include <gtest/gtest.h>

#include <set>

#include "math/rng.h"
#include "tests/support/lane_tools.h"

namespace metrofarm {
namespace {

struct KnownAnswer {
  uint32_t counter[4];
  RngKey key;
  uint32_t words[4];
};

// Known answers of philox4x32-10, published with Random123 (Salmon et al. 2011).
constexpr KnownAnswer kKnownAnswers[] = {
    {{0, 0, 0, 0}, {0, 0}, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
    {{0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff},
     {0xffffffff, 0xffffffff},
     {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
    {{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344},
     {0xa4093822, 0x299f31d0},
     {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
};

TEST(Philox, GivesTheKnownAnswersInEveryLane) {
  for (const KnownAnswer& k : kKnownAnswers) {
    const RngWords words = philox(
        k.key, {UInt(k.counter[0]), UInt(k.counter[1]), UInt(k.counter[2]), UInt(k.counter[3])});
    for (int w = 0; w < 4; ++w)
      for (int lane = 0; lane < kLanes; ++lane) EXPECT_EQ(lane_word(words[w], lane), k.words[w]);
  }
}

TEST(Philox, LanesDoNotMix) {
  UInt counter(7U);
  set_lane_word(counter, 3, 0);
  const RngWords words = philox({0, 0}, {counter, UInt(0U), UInt(0U), UInt(0U)});
  const RngWords zero = philox({0, 0}, {UInt(0U), UInt(0U), UInt(0U), UInt(0U)});
  const RngWords seven = philox({0, 0}, {UInt(7U), UInt(0U), UInt(0U), UInt(0U)});
  for (int w = 0; w < 4; ++w) {
    for (int lane = 0; lane < kLanes; ++lane) {
      const RngWords& expected = lane == 3 ? zero : seven;
      EXPECT_EQ(lane_word(words[w], lane), lane_word(expected[w], lane));
    }
  }
}

TEST(RngKey, PurposesAndSeedsGiveDifferentKeys) {
  std::set<uint64_t> keys;
  for (uint64_t seed = 0; seed < 1000; ++seed) {
    for (RngDomain domain : {RngDomain::kBootstrap, RngDomain::kChain, RngDomain::kPath}) {
      const RngKey key = rng_key(seed, domain);
      keys.insert(uint64_t{key.k1} << 32 | key.k0);
    }
  }
  EXPECT_EQ(keys.size(), 3000U);
}

TEST(Mix64, IsSplitMix64) {
  // First outputs of SplitMix64 seeded with 0 (Vigna's reference implementation).
  EXPECT_EQ(mix64(0), 0xe220a8397b1dcdafULL);
  EXPECT_EQ(mix64(1), 0x6e789e6aa1b965f4ULL);
}

}  // namespace
}  // namespace metrofarm
