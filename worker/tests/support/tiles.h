// Decodes tiles as the contract of metrofarm.farm.v1.Tile words it.
#pragma once

#include <zstd.h>

#include <cstdint>
#include <string>
#include <vector>

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

}  // namespace metrofarm::test
