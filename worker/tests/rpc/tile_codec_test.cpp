#include "rpc/tile_codec.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/support/tiles.h"

namespace metrofarm::rpc {
namespace {

TEST(TileCodec, DecodesToWhatWasEncoded) {
  std::mt19937_64 random(1);
  for (size_t count : {size_t{768}, size_t{3072}}) {
    std::vector<int64_t> values(count);
    for (int64_t& v : values) v = static_cast<int64_t>(random()) >> (random() % 60);
    values[0] = INT64_MIN;
    values[1] = INT64_MAX;
    values[2] = -1;
    EXPECT_EQ(test::decode_tile(encode_tile(values), count), values);
  }
}

TEST(TileCodec, TheFrameSaysItsSize) {
  const std::string frame = encode_tile(std::vector<int64_t>(3072, 5));
  EXPECT_EQ(ZSTD_getFrameContentSize(frame.data(), frame.size()), 8U * 3072U);
}

TEST(TileCodec, SmallValuesTakeLittleSpace) {
  std::mt19937_64 random(2);
  std::vector<int64_t> values(3072);
  for (int64_t& v : values) v = static_cast<int64_t>(random() % (1ULL << 24));
  EXPECT_LT(encode_tile(values).size(), 3072U * 4U);
}

}  // namespace
}  // namespace metrofarm::rpc
