// Counter-based random numbers: Philox4x32-10 (Salmon et al. 2011, "Parallel Random Numbers: As
// Easy as 1, 2, 3", section 3.3). A draw is a pure function of (key, counter), so any worker
// recomputes any sample, and the lanes need no state.
#pragma once

#include <array>
#include <cstdint>

#include "math/lanes.h"

namespace metrofarm {

// Finalizer of SplitMix64 over x's Weyl step: a bijection of 64-bit words.
constexpr uint64_t mix64(uint64_t x) {
  x = (x + 1) * 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

// What a stream of random numbers is for. Streams of one seed with different purposes are
// independent.
enum class RngDomain : uint64_t { kBootstrap = 1, kChain = 2, kPath = 3, kTest = 4 };

struct RngKey {
  uint32_t k0 = 0;
  uint32_t k1 = 0;
};

constexpr RngKey rng_key(uint64_t seed, RngDomain domain) {
  const uint64_t k = mix64(mix64(seed) ^ static_cast<uint64_t>(domain));
  return {static_cast<uint32_t>(k), static_cast<uint32_t>(k >> 32)};
}

using RngWords = std::array<UInt, 4>;

namespace rng_detail {

inline constexpr uint32_t kMul0 = 0xD2511F53U;
inline constexpr uint32_t kMul1 = 0xCD9E8D57U;
inline constexpr uint32_t kWeyl0 = 0x9E3779B9U;
inline constexpr uint32_t kWeyl1 = 0xBB67AE85U;

struct HiLo {
  UInt hi, lo;
};

inline HiLo multiply(UInt a, uint32_t multiplier) {
  const __m256i m = _mm256_set1_epi32(static_cast<int>(multiplier));
  const __m256i even = _mm256_mul_epu32(a, m);
  const __m256i odd = _mm256_mul_epu32(_mm256_srli_epi64(a, 32), m);
  return {_mm256_blend_epi32(_mm256_srli_epi64(even, 32), odd, 0xAA),
          _mm256_blend_epi32(even, _mm256_slli_epi64(odd, 32), 0xAA)};
}

}  // namespace rng_detail

// The four words of each lane's counter.
inline RngWords philox(RngKey key, RngWords c) {
  using namespace rng_detail;
  for (int round = 0; round < 10; ++round) {
    const HiLo p0 = multiply(c[0], kMul0);
    const HiLo p1 = multiply(c[2], kMul1);
    c = {p1.hi ^ c[1] ^ UInt(key.k0), p1.lo, p0.hi ^ c[3] ^ UInt(key.k1), p0.lo};
    key.k0 += kWeyl0;
    key.k1 += kWeyl1;
  }
  return c;
}

}  // namespace metrofarm
