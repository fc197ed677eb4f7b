// The primary samples of eight chains, evaluated lazily.
//
// Under the target, coordinates that the current path does not read are independent uniforms;
// redrawing them is a Gibbs move that is valid at any time. So only the pairs that the current
// state has read are kept, and all others are fresh whenever a proposal asks for them. The current
// state x and the proposals y and z of both stages exist side by side, whichever of them reads a
// pair. Every draw is a pure function of (chain, iteration, stage, slot), but for two that a pack
// makes for all its chains, so that its lanes do alike work: the coin that chooses the kind of
// step, and the technique of a large step. Each chain by itself is as if it drew them alone; chains
// of one pack depend on each other a little.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "metropolis/moves.h"
#include "primary_space/sample_source.h"

namespace metrofarm::metropolis {

// The chains of a pack, lane by lane, and the pack's number among those of the job.
struct PackMembers {
  // Chains first .. first + 7. Requires: a multiple of kLanes.
  PackMembers(uint32_t first);  // NOLINT(google-explicit-constructor)
  PackMembers(const std::array<uint32_t, kLanes>& chain_numbers, uint32_t pack_number)
      : chains(chain_numbers), pack(pack_number) {}

  std::array<uint32_t, kLanes> chains;
  uint32_t pack;
};

// What one iteration draws beside coordinates.
struct Coins {
  Float step;        // which kind of step; the same in all lanes
  Float acceptance;  // below the acceptance probability: accept
  Float second;      // the same of the second stage
};

// Which point pair() tells the coordinates of.
enum class Stage {
  kFirst,   // y
  kSecond,  // z
  kReverse  // z - (y - x), from which Green and Mira's rule judges z
};

// Which lanes take which step; the others a small one.
struct Steps {
  Mask large = no_lanes();  // draws every coordinate anew
  Mask eye = no_lanes();    // draws the eye subpath's anew and keeps the others
  Mask light = no_lanes();  // draws the light subpath's anew and keeps the others

  Mask subpath() const { return eye | light; }
  Mask small() const { return ~(large | eye | light); }
};

class MutatedSample final : public primary_space::SampleSource {
 public:
  // key: of the job's chains. `moves` outlives this.
  MutatedSample(RngKey key, const PackMembers& members, const Moves& moves);

  // Begins iteration number `iteration` (from 0), in its first stage, and returns its coins.
  Coins begin(uint64_t iteration);
  // Says which lanes take which step; before any pair is asked for.
  void set_steps(const Steps& steps) { steps_ = steps; }
  void enter(Stage stage) { stage_ = stage; }

  primary_space::Pair pair(primary_space::Slot slot, Mask lanes) override;
  std::vector<primary_space::StoredPair> read_pairs(int lane) const override;

  // ln of the ratio of the first stage's densities, from z to y over from x to y, over the pairs
  // that y and at least one of x and z have read: the same from x as from z. Other pairs have no
  // share in it. One that y has not read: integrated over y, its move from x to z is symmetric. One
  // that neither x nor z has read: integrated over both, y is uniform. Requires: z is evaluated.
  Float log_ratio() const;

  // In these lanes the proposal of the first or the second stage becomes the state; others keep
  // theirs.
  void finish(Mask first, Mask second);

  // Pairs asked for since the start, one for each lane, stage and slot.
  uint64_t pairs_read() const { return pairs_read_; }

  // State of one lane: exactly the pairs that its current path reads.
  std::vector<primary_space::StoredPair> stored(int lane) const;
  // Requires: slots in [0, kSlotCount).
  void restore(int lane, const std::vector<primary_space::StoredPair>& pairs);

 private:
  struct SlotState {
    primary_space::FixedPair current;
    primary_space::FixedPair first;
    uint32_t known = 0;     // lanes whose current state has read the slot
    uint32_t read[3] = {};  // lanes that have read it in each stage
    primary_space::FixedPair second;
  };

  SlotState& slot_state(primary_space::Slot slot);
  RngWords words(uint32_t slot) const;
  RngWords words_of_pack(uint32_t slot) const;
  primary_space::FixedPair fresh(primary_space::Slot slot, const RngWords& words) const;
  primary_space::FixedPair start(const SlotState& state, const RngWords& words) const;
  void propose(primary_space::Slot slot, SlotState& state) const;
  primary_space::FixedPair second(primary_space::Slot slot, const SlotState& state) const;
  primary_space::FixedPair reverse(primary_space::Slot slot, const SlotState& state) const;
  primary_space::Pair pair_of_later_stage(primary_space::Slot slot, SlotState& state, Mask lanes);
  void finish_later_stages(uint32_t taken);

  RngKey key_;
  UInt chains_;
  UInt pack_;
  const Moves& moves_;
  UInt iteration_low_ = UInt(0U);
  UInt iteration_high_ = UInt(0U);
  Steps steps_;
  Stage stage_ = Stage::kFirst;
  bool later_stages_ = false;     // have read something in this iteration
  std::vector<SlotState> slots_;  // grows with the longest path met
  int used_ = 0;                  // slots below this may be known or read
  uint64_t pairs_read_ = 0;
};

}  // namespace metrofarm::metropolis
