#include "primary_space/sample_source.h"

#include <algorithm>

#include "base/check.h"

namespace metrofarm::primary_space {

void IndependentSource::begin(uint64_t first) {
  alignas(32) uint32_t low[kLanes], high[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    low[i] = static_cast<uint32_t>(first + i);
    high[i] = static_cast<uint32_t>((first + i) >> 32);
  }
  index_low_ = UInt::load_aligned(low);
  index_high_ = UInt::load_aligned(high);
  std::fill_n(read_.begin(), used_, uint8_t{0});
  used_ = 0;
  words_of_ = 0xffffffffU;
}

FixedPair IndependentSource::fixed_pair(Slot slot) const {
  // Odd slots first: the slots of an eye vertex begin with an odd one.
  const auto counter = static_cast<uint32_t>(slot + 1) / 2;
  if (counter != words_of_) {
    words_ = philox(key_, {UInt(counter), index_low_, index_high_, UInt(0U)});
    words_of_ = counter;
  }
  return slot % 2 != 0 ? FixedPair{words_[0], words_[1]} : FixedPair{words_[2], words_[3]};
}

Pair IndependentSource::pair(Slot slot, Mask lanes) {
  METROFARM_CHECK(slot < kSlotCount);
  used_ = std::max(used_, slot + 1);
  read_[slot] |= static_cast<uint8_t>(bits(lanes));
  return pinned_pair(slot).to_float();
}

std::vector<StoredPair> IndependentSource::read_pairs(int lane) const {
  std::vector<StoredPair> out;
  for (Slot slot = 0; slot < used_; ++slot) {
    if ((read_[slot] >> lane & 1U) == 0) continue;
    const FixedPair p = pinned_pair(slot);
    out.push_back({slot, lane_word(p.first, lane), lane_word(p.second, lane)});
  }
  return out;
}

}  // namespace metrofarm::primary_space
