// Decodes tiles as the contract of metrofarm.farm.v1.Tile words it, and puts them into films.
#pragma once

#include <gtest/gtest.h>
#include <zstd.h>

#include <cstdint>
#include <string>
#include <vector>

#include "film/film.h"

namespace metrofarm::test {

// Values of a tile of `count` values; empty where the frame is not what it should be.
inline std::vector<int64_t> decode_tile(const std::string& data, size_t count) {
  std::vector<unsigned char> bytes(8 * count);
  if (ZSTD_decompress(bytes.data(), bytes.size(), data.data(), data.size()) != bytes.size())
    return {};
  std::vector<int64_t> values(count);
  for (size_t i = 0; i < count; ++i) {
    uint64_t v = 0;
    // All lowest bytes first, then all second bytes, up to the highest.
    for (size_t byte = 8; byte-- > 0;) v = v << 8 | bytes[byte * count + i];
    values[i] = static_cast<int64_t>(v);
  }
  return values;
}

// Adds a tile (a metrofarm.farm.v1.Tile) to a film and returns its share of the digest.
template <class Tile>
uint64_t add_tile(const Tile& tile, film::Film& film) {
  const int side = tile.low() ? film::kLowGrid : film::kTileSize;
  const std::vector<int64_t> v = decode_tile(tile.data(), size_t(side) * side * film::kChannels);
  EXPECT_FALSE(v.empty()) << "not a tile";
  if (v.empty()) return 0;
  const auto plane = static_cast<int>(tile.plane());
  uint64_t digest = 0;
  for (int i = 0; i < side * side; ++i) {
    const int64_t rgb[3] = {v[i], v[side * side + i], v[2 * side * side + i]};
    const int x = static_cast<int>(tile.x()) * side + i % side;
    const int y = static_cast<int>(tile.y()) * side + i / side;
    if (tile.low()) {
      digest += film.add_low(plane, i, rgb);
    } else if (x < film.shape().width && y < film.shape().height) {
      digest += film.add_full(plane, size_t(y) * film.shape().width + x, rgb);
    } else {
      EXPECT_TRUE(rgb[0] == 0 && rgb[1] == 0 && rgb[2] == 0) << "outside the image";
    }
  }
  return digest;
}

}  // namespace metrofarm::test
