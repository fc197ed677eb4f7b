// How one pair moves in both stages, as a function of random words alone. Shared by all chains.
//
// An orbital second stage turns x around y: with y = x + d, z = y - R(angle) d. Of an isotropic
// kernel, d is made from (length word, angle word a), and R(angle) d from (length word, a + angle).
// From z, the words (length, a + angle) lead to the same y, and -angle back to x, bit by bit: the
// map (x, length, a, angle) -> (z, length, a + angle, -angle) is its own inverse and keeps the
// uniform measure on words, so rounding breaks nothing, nor does a displacement that wraps. Where a
// coordinate is frozen its share of d and R d is dropped; it moves in the words only. Displacements
// of other kernels are turned in floats, which is reversible up to 2^-24 of their length.
#pragma once

#include "math/rng.h"
#include "metropolis/angle_table.h"
#include "metropolis/delayed_rejection.h"
#include "metropolis/kernel.h"

namespace metrofarm::metropolis {

class Moves {
 public:
  // Requires: problem_with(proposals) is empty.
  explicit Moves(const Proposals& proposals);

  const Kernel& kernel() const { return kernel_; }
  const DelayedRejection& delayed_rejection() const { return delayed_; }

  // y - x of a small step.
  primary_space::FixedPair first(primary_space::Slot slot, UInt word0, UInt word1) const {
    return thaw(slot, to_torus(stepper_.displacement(word0, word1)));
  }
  // z - x, where a small step was made of (word0, word1), after a large step where `large`.
  primary_space::FixedPair second(primary_space::Slot slot, const primary_space::FixedPair& words,
                                  const RngWords& own, Mask large) const;
  // ln of the ratio of the first stage's densities, z to y over x to y, after a small step; where z
  // cannot lead to y, minus infinity.
  Float log_ratio(primary_space::Slot slot, const primary_space::FixedPair& words,
                  const RngWords& own) const;

 private:
  primary_space::FixedPair thaw(primary_space::Slot slot, primary_space::FixedPair step) const {
    for (const FrozenPair& f : frozen_) {
      if (f.slot != slot) continue;
      if (f.first) step.first = UInt(0U);
      if (f.second) step.second = UInt(0U);
    }
    return step;
  }
  bool frozen(primary_space::Slot slot) const;

  Kernel kernel_;
  DelayedRejection delayed_;
  std::vector<FrozenPair> frozen_;
  Stepper stepper_;
  Stepper local_;
  AngleTable angles_;
};

}  // namespace metrofarm::metropolis
