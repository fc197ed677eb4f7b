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

FixedPair select(Mask m, const FixedPair& a, const FixedPair& b) {
  return {metrofarm::select(m, a.first, b.first), metrofarm::select(m, a.second, b.second)};
}

}  // namespace

MutatedSample::MutatedSample(RngKey key, UInt chain_ids, const Kernel& kernel)
    : key_(key), chains_(chain_ids), stepper_(kernel) {}

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
  const RngWords w = words(kCoinSlot);
  return {unit_float(w[0]), unit_float(w[1])};
}

void MutatedSample::propose(Slot slot, SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const FixedPair start = select(mask_from_bits(s.known), s.current, {w[0], w[1]});
  const FixedPair fresh{w[2], w[3]};
  s.proposal = all(large_) ? fresh : select(large_, fresh, stepper_.step(start, w[2], w[3]));
}

Pair MutatedSample::pair(Slot slot, Mask lanes) {
  SlotState& s = slot_state(slot);
  if (s.read == 0) {
    propose(slot, s);
    used_ = std::max(used_, slot + 1);
  }
  s.read |= bits(lanes);
  return s.proposal.to_float();
}

void MutatedSample::finish(Mask accepted) {
  const uint32_t taken = bits(accepted);
  int last_known = 0;
  for (int i = 0; i < used_; ++i) {
    SlotState& s = slots_[i];
    const uint32_t replaced = taken & s.read;
    if (replaced != 0) s.current = select(mask_from_bits(replaced), s.proposal, s.current);
    s.known = (s.known & ~taken) | replaced;
    s.read = 0;
    if (s.known != 0) last_known = i + 1;
  }
  used_ = last_known;
}

std::vector<StoredPair> MutatedSample::read_pairs(int lane) const {
  std::vector<StoredPair> out;
  for (int i = 0; i < used_; ++i) {
    const SlotState& s = slots_[i];
    if ((s.read >> lane & 1U) == 0) continue;
    out.push_back({i, lane_word(s.proposal.first, lane), lane_word(s.proposal.second, lane)});
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
