#include "primary_space/sample_source.h"

namespace metrofarm::primary_space {

void IndependentSource::begin(uint64_t first) {
  alignas(32) uint32_t low[kLanes], high[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    low[i] = static_cast<uint32_t>(first + i);
    high[i] = static_cast<uint32_t>((first + i) >> 32);
  }
  index_low_ = UInt::load_aligned(low);
  index_high_ = UInt::load_aligned(high);
  read_.clear();
}

FixedPair IndependentSource::fixed_pair(Slot slot) const {
  const RngWords words =
      philox(key_, {UInt(static_cast<uint32_t>(slot)), index_low_, index_high_, UInt(0U)});
  return {words[0], words[1]};
}

Pair IndependentSource::pair(Slot slot, Mask lanes) {
  if (static_cast<size_t>(slot) >= read_.size()) read_.resize(slot + 1, 0);
  read_[slot] |= static_cast<uint8_t>(bits(lanes));
  return fixed_pair(slot).to_float();
}

std::vector<StoredPair> IndependentSource::read_pairs(int lane) const {
  std::vector<StoredPair> out;
  for (size_t i = 0; i < read_.size(); ++i) {
    if ((read_[i] >> lane & 1U) == 0) continue;
    const auto slot = static_cast<Slot>(i);
    const FixedPair p = fixed_pair(slot);
    out.push_back({slot, lane_word(p.first, lane), lane_word(p.second, lane)});
  }
  return out;
}

}  // namespace metrofarm::primary_space
