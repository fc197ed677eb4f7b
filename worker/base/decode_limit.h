// How much memory the content of a file may take: small files can be made that stand for terabytes.
#pragma once

#include <cstdint>
#include <limits>

namespace metrofarm {

// An honest file of 4 MiB or more is never 64 times smaller than what it stands for: flat colours
// and repeated lines compress better, but then their files are small. Up to 256 MiB are free.
inline constexpr uint64_t kFreeDecodedBytes = uint64_t{256} << 20;
inline constexpr uint64_t kDecodedBytesPerByte = 64;

// Bytes that a file of file_bytes may be decoded to.
constexpr uint64_t decode_limit(uint64_t file_bytes) {
  constexpr uint64_t kMost = std::numeric_limits<uint64_t>::max();
  if (file_bytes > (kMost - kFreeDecodedBytes) / kDecodedBytesPerByte) return kMost;
  return kFreeDecodedBytes + kDecodedBytesPerByte * file_bytes;
}

}  // namespace metrofarm
