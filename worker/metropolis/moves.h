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

  // y of a small step from x.
  primary_space::FixedPair first(primary_space::Slot slot, const primary_space::FixedPair& x,
                                 UInt word0, UInt word1) const {
    const primary_space::FixedPair y = stepper_.step(x, word0, word1);
    return frozen_.empty() ? y : keep_frozen(slot, x, y);
  }
  // z of a second stage from x: after a small step that was made of two words, or after a large
  // step where `large`. own: words of the second stage.
  primary_space::FixedPair second(primary_space::Slot slot, const primary_space::FixedPair& x,
                                  const primary_space::FixedPair& words, const RngWords& own,
                                  Mask large) const;
  // ln of the ratio of the first stage's densities, z to y over x to y, after a small step; where z
  // cannot lead to y, minus infinity.
  Float log_ratio(primary_space::Slot slot, const primary_space::FixedPair& words,
                  const RngWords& own) const;

 private:
  // `to`, but for coordinates that are frozen, which are those of `from`.
  primary_space::FixedPair keep_frozen(primary_space::Slot slot,
                                       const primary_space::FixedPair& from,
                                       primary_space::FixedPair to) const;
  bool frozen(primary_space::Slot slot) const;
  // z - x with nothing frozen.
  primary_space::FixedPair second_step(const primary_space::FixedPair& words, const RngWords& own,
                                       Mask large) const;

  Kernel kernel_;
  DelayedRejection delayed_;
  std::vector<FrozenPair> frozen_;
  Stepper stepper_;
  Stepper local_;
  AngleTable angles_;
};

}  // namespace metrofarm::metropolis
