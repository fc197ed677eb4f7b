// Eight values side by side: the width at which the renderer traces and shades. All arithmetic is
// element-wise, free of libm and of contraction, so the same inputs give the same bits everywhere.
#pragma once

#include <immintrin.h>

#include <cstdint>
#include <type_traits>
#include <xsimd/xsimd.hpp>

namespace metrofarm {

inline constexpr int kLanes = 8;

using LaneArch = xsimd::fma3<xsimd::avx2>;
using Float = xsimd::batch<float, LaneArch>;
using Int = xsimd::batch<int32_t, LaneArch>;
using UInt = xsimd::batch<uint32_t, LaneArch>;
using Mask = xsimd::batch_bool<float, LaneArch>;

static_assert(Float::size == kLanes);

inline Mask all_lanes() {
  return Mask(true);
}
inline Mask no_lanes() {
  return Mask(false);
}

// Bit i is set where lane i is.
inline uint32_t bits(Mask m) {
  return static_cast<uint32_t>(_mm256_movemask_ps(m));
}
inline Mask mask_from_bits(uint32_t b) {
  const __m256i lane_bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  const __m256i set = _mm256_and_si256(_mm256_set1_epi32(static_cast<int>(b)), lane_bit);
  return _mm256_castsi256_ps(_mm256_cmpeq_epi32(set, lane_bit));
}
// The first n lanes.
inline Mask first_lanes(int n) {
  return mask_from_bits((1U << n) - 1U);
}

inline bool any(Mask m) {
  return bits(m) != 0;
}
inline bool none(Mask m) {
  return bits(m) == 0;
}
inline bool all(Mask m) {
  return bits(m) == 0xff;
}

inline Int as_int(Float f) {
  return _mm256_castps_si256(f);
}
inline UInt as_uint(Float f) {
  return _mm256_castps_si256(f);
}
inline UInt as_uint(Int i) {
  return static_cast<__m256i>(i);
}
inline Int as_int(UInt u) {
  return static_cast<__m256i>(u);
}
inline Float as_float(Int i) {
  return _mm256_castsi256_ps(i);
}
inline Mask as_mask(__m256i m) {
  return _mm256_castsi256_ps(m);
}

inline Mask equal(Int a, Int b) {
  return as_mask(_mm256_cmpeq_epi32(a, b));
}
template <class Enum>
  requires std::is_enum_v<Enum>
Mask equal(Int a, Enum b) {
  return equal(a, Int(static_cast<int32_t>(b)));
}
inline Mask less(Int a, Int b) {
  return as_mask(_mm256_cmpgt_epi32(b, a));
}
inline Float to_float(Int i) {
  return _mm256_cvtepi32_ps(i);
}
inline Int truncate(Float f) {
  return _mm256_cvttps_epi32(f);
}

// a where m, b elsewhere.
inline Float select(Mask m, Float a, Float b) {
  return _mm256_blendv_ps(b, a, m);
}
inline Int select(Mask m, Int a, Int b) {
  return as_int(select(m, as_float(a), as_float(b)));
}
inline UInt select(Mask m, UInt a, UInt b) {
  return as_uint(select(m, as_float(as_int(a)), as_float(as_int(b))));
}
// a where m, 0 elsewhere: also clears NaN in the other lanes.
inline Float keep(Mask m, Float a) {
  return _mm256_and_ps(a, m);
}

// table[index] per lane; lanes outside m are not read and give 0.
inline Float gather(const float* table, Int index, Mask m) {
  return _mm256_mask_i32gather_ps(_mm256_setzero_ps(), table, index, m, 4);
}
inline Int gather(const int32_t* table, Int index, Mask m) {
  return _mm256_mask_i32gather_epi32(_mm256_setzero_si256(), table, index, _mm256_castps_si256(m),
                                     4);
}
inline UInt gather(const uint32_t* table, Int index, Mask m) {
  return as_uint(gather(reinterpret_cast<const int32_t*>(table), index, m));
}

// Maps 32-bit fixed point to [0, 1): the upper 24 bits, so the result never rounds up to 1.
inline Float unit_float(UInt u) {
  const __m256i shifted = _mm256_srli_epi32(u, 8);
  return Float(_mm256_cvtepi32_ps(shifted)) * Float(0x1p-24F);
}

// One lane's value, for the rare code that looks at a single sample.
inline uint32_t lane_word(UInt u, int lane) {
  alignas(32) uint32_t words[kLanes];
  u.store_aligned(words);
  return words[lane];
}
inline void set_lane_word(UInt& u, int lane, uint32_t value) {
  alignas(32) uint32_t words[kLanes];
  u.store_aligned(words);
  words[lane] = value;
  u = UInt::load_aligned(words);
}
inline float lane_value(Float f, int lane) {
  alignas(32) float values[kLanes];
  f.store_aligned(values);
  return values[lane];
}
inline void set_lane_value(Float& f, int lane, float value) {
  alignas(32) float values[kLanes];
  f.store_aligned(values);
  values[lane] = value;
  f = Float::load_aligned(values);
}

inline Float sqr(Float x) {
  return x * x;
}
inline Float safe_sqrt(Float x) {
  return xsimd::sqrt(xsimd::max(x, Float(0.F)));
}

}  // namespace metrofarm
