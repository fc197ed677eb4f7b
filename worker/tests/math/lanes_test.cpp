#include "math/lanes.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "tests/support/lane_tools.h"

namespace metrofarm {
namespace {

using test::lanes_of;

TEST(Lanes, MasksAndBitsAreInverse) {
  for (uint32_t b = 0; b < 256; ++b) EXPECT_EQ(bits(mask_from_bits(b)), b);
  EXPECT_EQ(bits(first_lanes(0)), 0U);
  EXPECT_EQ(bits(first_lanes(3)), 7U);
  EXPECT_EQ(bits(first_lanes(8)), 0xffU);
  EXPECT_TRUE(all(all_lanes()));
  EXPECT_TRUE(none(no_lanes()));
  EXPECT_TRUE(any(mask_from_bits(0x80)));
  EXPECT_FALSE(all(mask_from_bits(0x7f)));
}

TEST(Lanes, SelectTakesTheFirstWhereSet) {
  const auto f = lanes_of(select(mask_from_bits(0b00000101), Float(1.F), Float(2.F)));
  EXPECT_EQ(f, (test::Lanes{1, 2, 1, 2, 2, 2, 2, 2}));
  const Int i = select(mask_from_bits(2), Int(-5), Int(7));
  EXPECT_EQ(lane_word(as_uint(i), 1), static_cast<uint32_t>(-5));
  EXPECT_EQ(lane_word(as_uint(i), 0), 7U);
  const UInt u = select(mask_from_bits(1), UInt(0xfff00000U), UInt(1U));
  EXPECT_EQ(lane_word(u, 0), 0xfff00000U);
}

TEST(Lanes, KeepClearsNanElsewhere) {
  const Float nan(std::numeric_limits<float>::quiet_NaN());
  const Float kept = keep(mask_from_bits(0x0f), select(mask_from_bits(0x0f), Float(3.F), nan));
  EXPECT_EQ(lanes_of(kept), (test::Lanes{3, 3, 3, 3, 0, 0, 0, 0}));
}

TEST(Lanes, GatherDoesNotTouchMaskedLanes) {
  const std::vector<float> table = {10, 20, 30};
  const Int index = _mm256_setr_epi32(0, 1, 2, 1 << 30, -(1 << 30), 1, 0, 1 << 29);
  EXPECT_EQ(lanes_of(gather(table.data(), index, mask_from_bits(0b01100111))),
            (test::Lanes{10, 20, 30, 0, 0, 20, 10, 0}));
}

TEST(Lanes, UnitFloatStaysBelowOne) {
  EXPECT_EQ(lane_value(unit_float(UInt(0U)), 0), 0.F);
  EXPECT_EQ(lane_value(unit_float(UInt(0x80000000U)), 0), 0.5F);
  EXPECT_LT(lane_value(unit_float(UInt(0xffffffffU)), 0), 1.F);
  EXPECT_EQ(lane_value(unit_float(UInt(0x100U)), 0), 0x1p-24F);
}

TEST(Lanes, SingleLanesAreReadAndWritten) {
  Float f(0.F);
  UInt u(0U);
  for (int lane = 0; lane < kLanes; ++lane) {
    set_lane_value(f, lane, static_cast<float>(lane));
    set_lane_word(u, lane, 100U + lane);
  }
  for (int lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(lane_value(f, lane), static_cast<float>(lane));
    EXPECT_EQ(lane_word(u, lane), 100U + lane);
  }
}

TEST(Lanes, SafeSqrtClampsRoundingErrors) {
  EXPECT_EQ(lane_value(safe_sqrt(Float(-1e-7F)), 0), 0.F);
  EXPECT_EQ(lane_value(safe_sqrt(Float(4.F)), 0), 2.F);
}

}  // namespace
}  // namespace metrofarm
