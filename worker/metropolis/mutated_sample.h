// The primary samples of eight chains, evaluated lazily.
//
// Under the target, coordinates that the current path does not read are independent uniforms;
// redrawing them is a Gibbs move that is valid at any time. So only the pairs that the current
// state has read are kept, and all others are fresh whenever a proposal asks for them. Every draw
// is a pure function of (chain, iteration, slot).
#pragma once

#include <cstdint>
#include <vector>

#include "metropolis/kernel.h"
#include "primary_space/sample_source.h"

namespace metrofarm::metropolis {

// What one iteration draws beside coordinates.
struct Coins {
  Float large;       // below the large-step probability: a large step
  Float acceptance;  // below the acceptance probability: accept
};

class MutatedSample final : public primary_space::SampleSource {
 public:
  // chain_ids: the chain of each lane; the key is that of the job's chains.
  MutatedSample(RngKey key, UInt chain_ids, const Kernel& kernel);

  // Begins iteration number `iteration` (from 0) and returns its coins.
  Coins begin(uint64_t iteration);
  // Says which lanes take a large step; before any pair is asked for.
  void set_large(Mask large) { large_ = large; }

  primary_space::Pair pair(primary_space::Slot slot, Mask lanes) override;
  std::vector<primary_space::StoredPair> read_pairs(int lane) const override;

  // In the accepted lanes the proposal's pairs become the state; others keep theirs.
  void finish(Mask accepted);

  // State of one lane: exactly the pairs that its current path reads.
  std::vector<primary_space::StoredPair> stored(int lane) const;
  // Requires: slots in [0, kSlotCount).
  void restore(int lane, const std::vector<primary_space::StoredPair>& pairs);

 private:
  struct SlotState {
    primary_space::FixedPair current;
    primary_space::FixedPair proposal;
    uint32_t known = 0;  // lanes whose current state has read the slot
    uint32_t read = 0;   // lanes whose proposal has read it
  };

  SlotState& slot_state(primary_space::Slot slot);
  RngWords words(uint32_t slot) const;
  void propose(primary_space::Slot slot, SlotState& state) const;

  RngKey key_;
  UInt chains_;
  Stepper stepper_;
  UInt iteration_low_ = UInt(0U);
  UInt iteration_high_ = UInt(0U);
  Mask large_ = no_lanes();
  std::vector<SlotState> slots_;  // grows with the longest path met
  int used_ = 0;                  // slots below this may be known or read
};

}  // namespace metrofarm::metropolis
