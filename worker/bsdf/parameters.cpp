#include "bsdf/parameters.h"

namespace metrofarm::bsdf {
namespace {

// out[k] = table[first[lane] + k] for k in 0..3: eight four-wide loads and a transpose, which take
// about half the time of gathers.
void load_four(const float* table, const int32_t* first, Float* out) {
  const auto rows = [&](int low) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(table + first[low])),
                                _mm_loadu_ps(table + first[low + 4]), 1);
  };
  const __m256 r0 = rows(0), r1 = rows(1), r2 = rows(2), r3 = rows(3);
  const __m256 xy01 = _mm256_unpacklo_ps(r0, r1), zw01 = _mm256_unpackhi_ps(r0, r1);
  const __m256 xy23 = _mm256_unpacklo_ps(r2, r3), zw23 = _mm256_unpackhi_ps(r2, r3);
  out[0] = _mm256_shuffle_ps(xy01, xy23, 0x44);
  out[1] = _mm256_shuffle_ps(xy01, xy23, 0xee);
  out[2] = _mm256_shuffle_ps(zw01, zw23, 0x44);
  out[3] = _mm256_shuffle_ps(zw01, zw23, 0xee);
}

}  // namespace

int ParameterTable::add(const Row& row) {
  values_.insert(values_.end(), row.values.begin(), row.values.end());
  textures_.insert(textures_.end(), row.textures.begin(), row.textures.end());
  colour_columns_.push_back(static_cast<int32_t>(row.colour_columns));
  scalar_columns_.push_back(static_cast<int32_t>(row.scalar_columns));
  textured_ = textured_ || row.colour_columns != 0 || row.scalar_columns != 0;
  return static_cast<int>(colour_columns_.size()) - 1;
}

void ParameterTable::load(Int row, Mask lanes, int count, Parameters& out) const {
  static_assert(kMaxColumns % 4 == 0);
  const Int masked = _mm256_and_si256(row * Int(kMaxColumns), _mm256_castps_si256(lanes));
  alignas(32) int32_t first[kLanes];
  masked.store_aligned(first);
  for (int column = 0; column < count; column += 4) {
    load_four(values_.data() + column, first, out.columns + column);
  }
}

}  // namespace metrofarm::bsdf
