#include "metropolis/mutated_sample.h"

#include <algorithm>

#include "base/check.h"

namespace metrofarm::metropolis {

using primary_space::FixedPair;
using primary_space::kSlotCount;
using primary_space::Pair;
using primary_space::Slot;
using primary_space::StoredPair;

namespace {

constexpr uint32_t kCoinSlot = 0xffffffffU;
// Sets the second stage's words apart from the first's.
constexpr uint32_t kSecondStage = 0x80000000U;

FixedPair select(Mask m, const FixedPair& a, const FixedPair& b) {
  return {metrofarm::select(m, a.first, b.first), metrofarm::select(m, a.second, b.second)};
}

FixedPair sum(const FixedPair& a, const FixedPair& b) {
  return {a.first + b.first, a.second + b.second};
}

}  // namespace

MutatedSample::MutatedSample(RngKey key, UInt chain_ids, const Moves& moves)
    : key_(key), chains_(chain_ids), moves_(moves) {}

MutatedSample::SlotState& MutatedSample::slot_state(Slot slot) {
  METROFARM_CHECK(slot >= 0 && slot < kSlotCount);
  const auto needed = static_cast<size_t>(slot) + 1;
  if (needed > slots_.size()) slots_.resize(std::max(needed, 2 * slots_.size()));
  return slots_[slot];
}

RngWords MutatedSample::words(uint32_t slot) const {
  return philox(key_, {UInt(slot), iteration_low_, iteration_high_, chains_});
}

Coins MutatedSample::begin(uint64_t iteration) {
  iteration_low_ = UInt(static_cast<uint32_t>(iteration));
  iteration_high_ = UInt(static_cast<uint32_t>(iteration >> 32));
  stage_ = Stage::kFirst;
  const RngWords w = words(kCoinSlot);
  return {unit_float(w[0]), unit_float(w[1]), unit_float(w[2])};
}

// x: the current state where that has read the pair, fresh elsewhere.
FixedPair MutatedSample::start(const SlotState& s, const RngWords& w) const {
  return select(mask_from_bits(s.known), s.current, {w[0], w[1]});
}

FixedPair MutatedSample::first(Slot slot, const SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const FixedPair fresh{w[2], w[3]};
  if (all(large_)) return fresh;
  return select(large_, fresh, sum(start(s, w), moves_.first(slot, w[2], w[3])));
}

FixedPair MutatedSample::second(Slot slot, const SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const RngWords own = words(static_cast<uint32_t>(slot) | kSecondStage);
  return sum(start(s, w), moves_.second(slot, {w[2], w[3]}, own, large_));
}

FixedPair MutatedSample::reverse(Slot slot, const SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const FixedPair step = moves_.first(slot, w[2], w[3]);
  const FixedPair z = second(slot, s);
  return {z.first - step.first, z.second - step.second};
}

FixedPair MutatedSample::at_stage(Slot slot, SlotState& s) {
  const uint32_t read = s.read[static_cast<int>(stage_)];
  switch (stage_) {
    case Stage::kFirst:
      if (read == 0) s.first = first(slot, s);
      return s.first;
    case Stage::kSecond:
      if (read == 0) s.second = second(slot, s);
      return s.second;
    case Stage::kReverse:
      break;
  }
  return reverse(slot, s);
}

Pair MutatedSample::pair(Slot slot, Mask lanes) {
  SlotState& s = slot_state(slot);
  const FixedPair p = at_stage(slot, s);
  s.read[static_cast<int>(stage_)] |= bits(lanes);
  used_ = std::max(used_, slot + 1);
  return p.to_float();
}

Float MutatedSample::log_ratio() const {
  Float total(0.F);
  for (int slot = 0; slot < used_; ++slot) {
    const uint32_t read = slots_[slot].read[static_cast<int>(Stage::kFirst)];
    if (read == 0) continue;
    const RngWords w = words(static_cast<uint32_t>(slot));
    const RngWords own = words(static_cast<uint32_t>(slot) | kSecondStage);
    total += keep(mask_from_bits(read), moves_.log_ratio(slot, {w[2], w[3]}, own));
  }
  return total;
}

void MutatedSample::finish(Mask first, Mask second) {
  const uint32_t to_first = bits(first), to_second = bits(second);
  const uint32_t moved = to_first | to_second;
  int last_known = 0;
  for (int i = 0; i < used_; ++i) {
    SlotState& s = slots_[i];
    const uint32_t by_first = to_first & s.read[0], by_second = to_second & s.read[1];
    if (by_first != 0) s.current = select(mask_from_bits(by_first), s.first, s.current);
    if (by_second != 0) s.current = select(mask_from_bits(by_second), s.second, s.current);
    s.known = (s.known & ~moved) | by_first | by_second;
    for (uint32_t& read : s.read) {
      pairs_read_ += __builtin_popcount(read);
      read = 0;
    }
    if (s.known != 0) last_known = i + 1;
  }
  used_ = last_known;
}

std::vector<StoredPair> MutatedSample::read_pairs(int lane) const {
  std::vector<StoredPair> out;
  for (int i = 0; i < used_; ++i) {
    const SlotState& s = slots_[i];
    if ((s.read[static_cast<int>(stage_)] >> lane & 1U) == 0) continue;
    const FixedPair p = stage_ == Stage::kFirst    ? s.first
                        : stage_ == Stage::kSecond ? s.second
                                                   : reverse(i, s);
    out.push_back({i, lane_word(p.first, lane), lane_word(p.second, lane)});
  }
  return out;
}

std::vector<StoredPair> MutatedSample::stored(int lane) const {
  std::vector<StoredPair> out;
  for (int i = 0; i < used_; ++i) {
    const SlotState& s = slots_[i];
    if ((s.known >> lane & 1U) == 0) continue;
    out.push_back({i, lane_word(s.current.first, lane), lane_word(s.current.second, lane)});
  }
  return out;
}

void MutatedSample::restore(int lane, const std::vector<StoredPair>& pairs) {
  for (SlotState& s : slots_) s.known &= ~(1U << lane);
  for (const StoredPair& p : pairs) {
    SlotState& s = slot_state(p.slot);
    set_lane_word(s.current.first, lane, p.first);
    set_lane_word(s.current.second, lane, p.second);
    s.known |= 1U << lane;
    used_ = std::max(used_, p.slot + 1);
  }
}

}  // namespace metrofarm::metropolis
