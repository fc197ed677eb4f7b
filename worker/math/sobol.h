// Sobol's sequence (Sobol 1967) with the direction numbers of Joe and Kuo 2008, "Constructing Sobol
// Sequences with Better Two-Dimensional Projections" (new-joe-kuo-6), and Owen's nested uniform
// scrambling (Owen 1995) in the hashed form of Laine and Karras 2011, section 3.1, and Burley 2020,
// "Practical Hash-based Owen Scrambling".
//
// Words are kept with their bits reversed (bit 0 is worth 1/2): there a carry runs from the coarse
// digits to the fine ones, which is the direction in which nested scrambling depends on digits.
#pragma once

#include <array>
#include <cstdint>

#include "math/lanes.h"

namespace metrofarm {

inline constexpr int kSobolDimensions = 14;

namespace sobol_detail {

// Primitive polynomial over GF(2): its degree, its inner coefficients, and the first direction
// integers m_1 .. m_degree.
struct Polynomial {
  int degree;
  uint32_t coefficients;
  std::array<uint32_t, 6> m;
};

// Dimensions from the second on; the first is van der Corput's sequence.
inline constexpr std::array<Polynomial, kSobolDimensions - 1> kPolynomials = {{
    {1, 0, {1}},
    {2, 1, {1, 3}},
    {3, 1, {1, 3, 1}},
    {3, 2, {1, 1, 1}},
    {4, 1, {1, 1, 3, 3}},
    {4, 4, {1, 3, 5, 13}},
    {5, 2, {1, 1, 5, 5, 17}},
    {5, 4, {1, 1, 5, 5, 5}},
    {5, 7, {1, 1, 7, 11, 19}},
    {5, 11, {1, 1, 5, 1, 1}},
    {5, 13, {1, 1, 1, 3, 11}},
    {5, 14, {1, 3, 5, 5, 31}},
    {6, 1, {1, 3, 3, 9, 7, 49}},
}};

using Columns = std::array<uint32_t, 32>;

constexpr uint32_t reverse_bits(uint32_t x) {
  x = (x >> 16) | (x << 16);
  x = ((x & 0xff00ff00U) >> 8) | ((x & 0x00ff00ffU) << 8);
  x = ((x & 0xf0f0f0f0U) >> 4) | ((x & 0x0f0f0f0fU) << 4);
  x = ((x & 0xccccccccU) >> 2) | ((x & 0x33333333U) << 2);
  return ((x & 0xaaaaaaaaU) >> 1) | ((x & 0x55555555U) << 1);
}

// Column i is the reversed word that bit i of the index contributes (Bratley and Fox 1988, eq. 2).
constexpr Columns columns_of(int dimension) {
  Columns v{};
  for (int i = 0; i < 32; ++i) v[i] = 1U << (31 - i);
  if (dimension > 0) {
    const Polynomial& p = kPolynomials[dimension - 1];
    for (int i = 0; i < p.degree; ++i) v[i] = p.m[i] << (31 - i);
    for (int i = p.degree; i < 32; ++i) {
      v[i] = v[i - p.degree] ^ (v[i - p.degree] >> p.degree);
      for (int k = 1; k < p.degree; ++k)
        if ((p.coefficients >> (p.degree - 1 - k) & 1U) != 0) v[i] ^= v[i - k];
    }
  }
  for (uint32_t& column : v) column = reverse_bits(column);
  return v;
}

constexpr std::array<Columns, kSobolDimensions> all_columns() {
  std::array<Columns, kSobolDimensions> out{};
  for (int d = 0; d < kSobolDimensions; ++d) out[d] = columns_of(d);
  return out;
}

inline constexpr std::array<Columns, kSobolDimensions> kColumns = all_columns();

// Bit i of each byte to bit 7 - i, and the bytes of each word turned round.
inline UInt reverse_bits(UInt x) {
  const __m256i nibble = _mm256_set1_epi8(0x0f);
  const __m256i reversed_nibbles = _mm256_broadcastsi128_si256(_mm_setr_epi8(
      0x0, 0x8, 0x4, 0xc, 0x2, 0xa, 0x6, 0xe, 0x1, 0x9, 0x5, 0xd, 0x3, 0xb, 0x7, 0xf));
  const __m256i byte_order = _mm256_broadcastsi128_si256(
      _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12));
  const __m256i low = _mm256_shuffle_epi8(reversed_nibbles, _mm256_and_si256(x, nibble));
  const __m256i high =
      _mm256_shuffle_epi8(reversed_nibbles, _mm256_and_si256(_mm256_srli_epi16(x, 4), nibble));
  return _mm256_shuffle_epi8(_mm256_or_si256(_mm256_slli_epi16(low, 4), high), byte_order);
}

}  // namespace sobol_detail

// Coordinate `dimension` of point `index`, bits reversed. Points are linear over GF(2): for i and j
// without a common bit, the word of i + j is the exclusive or of their words.
constexpr uint32_t sobol_reversed(uint32_t index, int dimension) {
  uint32_t word = 0;
  for (int i = 0; index != 0; ++i, index >>= 1)
    if ((index & 1U) != 0) word ^= sobol_detail::kColumns[dimension][i];
  return word;
}

// Random words that determine one scrambling.
struct ScrambleKey {
  UInt seed, shift;
};

// Scrambles reversed words and turns them round: 32-bit fixed point in [0, 1). Hashing alone is
// only nearly uniform over its seeds; the digital shift makes every point exactly so.
inline UInt owen_scramble(UInt reversed, const ScrambleKey& key) {
  UInt x = reversed;
  // A multiplier that is even, or added to x's own, lets a digit change finer digits only.
  x = x ^ (x * UInt(0x3d20adeaU));
  x = x + key.seed;
  x = x * ((key.seed >> 16) | UInt(1U));
  x = x ^ (x * UInt(0x05526c56U));
  x = x ^ (x * UInt(0x53a22864U));
  return sobol_detail::reverse_bits(x) ^ key.shift;
}

}  // namespace metrofarm
