#include "texture/images.h"

#include <gtest/gtest.h>

#include "mitsuba_values.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::texture::test {
namespace {

using metrofarm::test::lane_of;

TEST(Images, DecodesSrgbAsMitsubaDoes) {
  std::vector<uint8_t> bytes;
  for (const ByteValue& row : kByteValues) bytes.push_back(static_cast<uint8_t>(row.byte));
  const int width = static_cast<int>(bytes.size());
  std::vector<scene::Image> list;
  list.push_back({width, 1, 1, bytes, true});
  list.push_back({width, 1, 1, bytes, false});
  const Images images(std::move(list));
  for (int x = 0; x < width; ++x) {
    EXPECT_NEAR(images.pixel(0, x, 0)[1], kByteValues[x].linear, 1e-6);
    EXPECT_FLOAT_EQ(images.pixel(1, x, 0)[1], static_cast<float>(kByteValues[x].byte) / 255);
  }
}

TEST(Images, ReadsEveryLayout) {
  std::vector<scene::Image> list;
  list.push_back({2, 2, 1, std::vector<uint8_t>{0, 51, 102, 255}});
  list.push_back({2, 1, 3, std::vector<uint8_t>{0, 51, 102, 153, 204, 255}});
  list.push_back({1, 2, 4, std::vector<uint8_t>{0, 51, 102, 7, 153, 204, 255, 7}});
  list.push_back({2, 1, 1, std::vector<float>{-1, 5}});
  list.push_back({1, 2, 3, std::vector<float>{1, 2, 3, 4, 5, 6}});
  list.push_back({1, 2, 4, std::vector<float>{1, 2, 3, 9, 4, 5, 6, 9}});
  const Images images(std::move(list));
  EXPECT_EQ(images.width(0), 2);
  EXPECT_EQ(images.height(2), 2);
  const Int image = Int(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 99, 0));
  const Int x = Int(_mm256_setr_epi32(1, 1, 0, 1, 0, 0, 0, 1));
  const Int y = Int(_mm256_setr_epi32(0, 0, 1, 0, 1, 1, 0, 1));
  const Spectrum colour = images.pixel(image, x, y, mask_from_bits(0xbf));
  const double expected[kLanes][3] = {{0.2, 0.2, 0.2}, {0.6, 0.8, 1}, {0.6, 0.8, 1}, {5, 5, 5},
                                      {4, 5, 6},       {4, 5, 6},     {0, 0, 0},     {1, 1, 1}};
  for (int lane = 0; lane < kLanes; ++lane) {
    EXPECT_FLOAT_EQ(lane_of(colour, lane).x, expected[lane][0]) << lane;
    EXPECT_FLOAT_EQ(lane_of(colour, lane).y, expected[lane][1]) << lane;
    EXPECT_FLOAT_EQ(lane_of(colour, lane).z, expected[lane][2]) << lane;
  }
}

TEST(Images, TakesNoMoreMemoryThanItsPixels) {
  std::vector<scene::Image> list;
  list.push_back({1000, 1000, 3, std::vector<uint8_t>(3000000)});
  const auto* pixels = std::get<0>(list[0].pixels).data();
  const Images images(std::move(list));
  EXPECT_LT(images.bytes(), 3010000U);
  EXPECT_NE(pixels, nullptr);
}

}  // namespace
}  // namespace metrofarm::texture::test
