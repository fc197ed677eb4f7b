// Where a path gets its primary sample from. The light half of the renderer knows this interface
// and nothing of chains.
#pragma once

#include <vector>

#include "math/lanes.h"
#include "math/rng.h"
#include "primary_space/slots.h"

namespace metrofarm::primary_space {

// One pair of coordinates in [0, 1), of eight samples.
struct Pair {
  Float first, second;
};

// The same in 32-bit fixed point: the torus [0, 1) with exact wrap-around.
struct FixedPair {
  UInt first, second;

  Pair to_float() const { return {unit_float(first), unit_float(second)}; }
};

// A pair of one sample as it is stored and sent.
struct StoredPair {
  Slot slot;
  uint32_t first, second;
};

class SampleSource {
 public:
  virtual ~SampleSource() = default;
  // The pair in `slot` of the active lanes; the same answer however often it is asked.
  virtual Pair pair(Slot slot, Mask lanes) = 0;
  // The pairs of one lane that have been read, in slot order.
  virtual std::vector<StoredPair> read_pairs(int lane) const = 0;
};

// Independent uniform samples: lane i is the sample number index[i] of a stream.
class IndependentSource : public SampleSource {
 public:
  explicit IndependentSource(RngKey key) : key_(key), read_(kSlotCount) {}

  // Begins samples first .. first + 7.
  void begin(uint64_t first);
  // From now on the first coordinate in `slot` is this one, of all samples.
  void pin(Slot slot, uint32_t first) {
    pinned_slot_ = slot;
    pinned_first_ = first;
  }

  Pair pair(Slot slot, Mask lanes) override;
  std::vector<StoredPair> read_pairs(int lane) const override;

 protected:
  virtual FixedPair fixed_pair(Slot slot) const;
  // The words of a counter that is this sample's own.
  RngWords random_words(uint32_t counter, UInt id_low, UInt id_high, uint32_t purpose) const {
    return philox(key_, {UInt(counter), id_low, id_high, UInt(purpose)});
  }

 private:
  FixedPair pinned_pair(Slot slot) const {
    FixedPair p = fixed_pair(slot);
    if (slot == pinned_slot_) p.first = UInt(pinned_first_);
    return p;
  }

  RngKey key_;
  Slot pinned_slot_ = -1;  // none
  uint32_t pinned_first_ = 0;
  UInt index_low_ = UInt(0U);
  UInt index_high_ = UInt(0U);
  std::vector<uint8_t> read_;  // lanes that have read each slot
  Slot used_ = 0;              // slots from here on are unread
  // One counter gives the pairs of two neighbouring slots, which paths read one after the other.
  mutable RngWords words_ = {};
  mutable uint32_t words_of_ = 0xffffffffU;
};

}  // namespace metrofarm::primary_space
