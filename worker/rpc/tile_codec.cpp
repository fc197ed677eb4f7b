#include "rpc/tile_codec.h"

#include <zstd.h>

#include <vector>

#include "base/check.h"

namespace metrofarm::rpc {
namespace {

// Fast: the shuffle has already put the zeros and sign bytes together.
constexpr int kLevel = 1;

}  // namespace

std::string encode_tile(std::span<const int64_t> values) {
  const size_t n = values.size();
  std::vector<char> shuffled(8 * n);
  for (size_t i = 0; i < n; ++i) {
    const auto v = static_cast<uint64_t>(values[i]);
    for (size_t byte = 0; byte < 8; ++byte)
      shuffled[byte * n + i] = static_cast<char>(v >> (8 * byte) & 0xff);
  }
  std::string out(ZSTD_compressBound(shuffled.size()), '\0');
  const size_t size =
      ZSTD_compress(out.data(), out.size(), shuffled.data(), shuffled.size(), kLevel);
  METROFARM_CHECK(ZSTD_isError(size) == 0);
  out.resize(size);
  return out;
}

}  // namespace metrofarm::rpc
