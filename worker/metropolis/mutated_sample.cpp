#include "metropolis/mutated_sample.h"

#include <algorithm>
#include <numeric>

#include "base/check.h"

namespace metrofarm::metropolis {

using primary_space::FixedPair;
using primary_space::kSlotCount;
using primary_space::Pair;
using primary_space::Slot;
using primary_space::StoredPair;

namespace {

constexpr uint32_t kCoinSlot = 0xffffffffU;
// Of the pack's own draws.
constexpr uint32_t kPackCoinSlot = 0xfffffffeU;
constexpr uint32_t kPackTechniqueSlot = 0xfffffffdU;
// Sets the second stage's words apart from the first's.
constexpr uint32_t kSecondStage = 0x80000000U;

FixedPair select(Mask m, const FixedPair& a, const FixedPair& b) {
  return {metrofarm::select(m, a.first, b.first), metrofarm::select(m, a.second, b.second)};
}

}  // namespace

PackMembers::PackMembers(uint32_t first) : pack(first / kLanes) {
  std::iota(chains.begin(), chains.end(), first);
}

MutatedSample::MutatedSample(RngKey key, const PackMembers& members, const Moves& moves)
    : key_(key),
      chains_(UInt::load_unaligned(members.chains.data())),
      pack_(members.pack),
      moves_(moves) {}

MutatedSample::SlotState& MutatedSample::slot_state(Slot slot) {
  METROFARM_CHECK(slot >= 0 && slot < kSlotCount);
  const auto needed = static_cast<size_t>(slot) + 1;
  if (needed > slots_.size()) slots_.resize(std::max(needed, 2 * slots_.size()));
  return slots_[slot];
}

RngWords MutatedSample::words(uint32_t slot) const {
  return philox(key_, {UInt(slot), iteration_low_, iteration_high_, chains_});
}

RngWords MutatedSample::words_of_pack(uint32_t slot) const {
  return philox(key_, {UInt(slot), iteration_low_, iteration_high_, pack_});
}

// What a large step draws.
FixedPair MutatedSample::fresh(Slot slot, const RngWords& words) const {
  if (slot != primary_space::kTechniqueSlot) return {words[2], words[3]};
  const RngWords shared = words_of_pack(kPackTechniqueSlot);
  return {shared[0], shared[1]};
}

Coins MutatedSample::begin(uint64_t iteration) {
  iteration_low_ = UInt(static_cast<uint32_t>(iteration));
  iteration_high_ = UInt(static_cast<uint32_t>(iteration >> 32));
  stage_ = Stage::kFirst;
  const RngWords w = words(kCoinSlot);
  return {unit_float(words_of_pack(kPackCoinSlot)[0]), unit_float(w[1]), unit_float(w[2])};
}

// x: the current state where that has read the pair, fresh elsewhere.
FixedPair MutatedSample::start(const SlotState& s, const RngWords& w) const {
  return select(mask_from_bits(s.known), s.current, {w[0], w[1]});
}

void MutatedSample::propose(Slot slot, SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const FixedPair anew = fresh(slot, w);
  s.first = anew;
  if (all(steps_.large)) return;
  const FixedPair x = start(s, w);
  s.first = select(steps_.large, anew, moves_.first(slot, x, w[2], w[3]));
  const Mask subpath = steps_.subpath();
  if (none(subpath)) return;
  const primary_space::Stream stream = primary_space::stream_of(slot);
  const Mask drawn = stream == primary_space::Stream::kEye     ? steps_.eye
                     : stream == primary_space::Stream::kLight ? steps_.light
                                                               : no_lanes();
  s.first = select(subpath, select(drawn, anew, x), s.first);
}

FixedPair MutatedSample::second(Slot slot, const SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const RngWords own = words(static_cast<uint32_t>(slot) | kSecondStage);
  return moves_.second(slot, start(s, w), {w[2], w[3]}, own, steps_.large);
}

FixedPair MutatedSample::reverse(Slot slot, const SlotState& s) const {
  const RngWords w = words(static_cast<uint32_t>(slot));
  const FixedPair x = start(s, w), y = moves_.first(slot, x, w[2], w[3]), z = second(slot, s);
  return {z.first - (y.first - x.first), z.second - (y.second - x.second)};
}

Pair MutatedSample::pair(Slot slot, Mask lanes) {
  SlotState& s = slot_state(slot);
  used_ = std::max(used_, slot + 1);
  if (stage_ != Stage::kFirst) return pair_of_later_stage(slot, s, lanes);
  uint32_t& read = s.read[static_cast<int>(Stage::kFirst)];
  if (read == 0) propose(slot, s);
  read |= bits(lanes);
  return s.first.to_float();
}

Pair MutatedSample::pair_of_later_stage(Slot slot, SlotState& s, Mask lanes) {
  later_stages_ = true;
  uint32_t& read = s.read[static_cast<int>(stage_)];
  const bool asked = read != 0;
  read |= bits(lanes);
  if (stage_ == Stage::kReverse) return reverse(slot, s).to_float();
  if (!asked) s.second = second(slot, s);
  return s.second.to_float();
}

Float MutatedSample::log_ratio() const {
  Float total(0.F);
  for (int slot = 0; slot < used_; ++slot) {
    const SlotState& s = slots_[slot];
    const uint32_t read = s.read[static_cast<int>(Stage::kFirst)] &
                          (s.known | s.read[static_cast<int>(Stage::kSecond)]);
    if (read == 0) continue;
    const RngWords w = words(static_cast<uint32_t>(slot));
    const RngWords own = words(static_cast<uint32_t>(slot) | kSecondStage);
    total += keep(mask_from_bits(read), moves_.log_ratio(slot, {w[2], w[3]}, own));
  }
  return total;
}

void MutatedSample::finish(Mask first, Mask second) {
  if (later_stages_) finish_later_stages(bits(second));
  const uint32_t taken = bits(first);
  int last_known = 0;
  for (int i = 0; i < used_; ++i) {
    SlotState& s = slots_[i];
    uint32_t& read = s.read[static_cast<int>(Stage::kFirst)];
    const uint32_t replaced = taken & read;
    if (replaced != 0) s.current = select(mask_from_bits(replaced), s.first, s.current);
    s.known = (s.known & ~taken) | replaced;
    pairs_read_ += __builtin_popcount(read);
    read = 0;
    if (s.known != 0) last_known = i + 1;
  }
  used_ = last_known;
}

void MutatedSample::finish_later_stages(uint32_t taken) {
  for (int i = 0; i < used_; ++i) {
    SlotState& s = slots_[i];
    const uint32_t replaced = taken & s.read[static_cast<int>(Stage::kSecond)];
    if (replaced != 0) s.current = select(mask_from_bits(replaced), s.second, s.current);
    s.known = (s.known & ~taken) | replaced;
    for (Stage stage : {Stage::kSecond, Stage::kReverse}) {
      uint32_t& read = s.read[static_cast<int>(stage)];
      pairs_read_ += __builtin_popcount(read);
      read = 0;
    }
  }
  later_stages_ = false;
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
