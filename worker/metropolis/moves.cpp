#include "metropolis/moves.h"

#include <algorithm>
#include <limits>

namespace metrofarm::metropolis {

using primary_space::FixedPair;
using primary_space::Slot;

namespace {

FixedPair difference(const FixedPair& a, const FixedPair& b) {
  return {a.first - b.first, a.second - b.second};
}

FixedPair select(Mask m, const FixedPair& a, const FixedPair& b) {
  return {metrofarm::select(m, a.first, b.first), metrofarm::select(m, a.second, b.second)};
}

}  // namespace

Moves::Moves(const Proposals& proposals)
    : kernel_(proposals.kernel),
      delayed_(proposals.delayed_rejection),
      frozen_(proposals.frozen),
      stepper_(kernel_),
      local_(scaled(kernel_, delayed_.local_scale)),
      angles_(delayed_.angle_law, delayed_.concentration) {}

bool Moves::frozen(Slot slot) const {
  return std::any_of(frozen_.begin(), frozen_.end(),
                     [slot](const FrozenPair& f) { return f.slot == slot && f.first && f.second; });
}

FixedPair Moves::second(Slot slot, const FixedPair& words, const RngWords& own, Mask large) const {
  const bool orbital = delayed_.move == SecondMove::kOrbital;
  FixedPair local{UInt(0U), UInt(0U)};
  if (!orbital || any(large)) local = to_torus(local_.displacement(own[0], own[1]));
  if (!orbital || all(large)) return thaw(slot, local);
  const FixedPair step = to_torus(stepper_.displacement(words.first, words.second));
  const UInt angle = angles_.angle(own[2]);
  const FixedPair turned = to_torus(stepper_.turned(words.first, words.second, angle));
  return thaw(slot, select(large, local, difference(step, turned)));
}

Float Moves::log_ratio(Slot slot, const FixedPair& words, const RngWords& own) const {
  const bool orbital = delayed_.move == SecondMove::kOrbital;
  if (frozen(slot) || (orbital && stepper_.isotropic())) return Float(0.F);
  const Displacement made = stepper_.displacement(words.first, words.second);
  Displacement there = made, back = made;  // x to y, z to y
  if (orbital) {
    back = stepper_.turned(words.first, words.second, angles_.angle(own[2]));
  } else {
    const FixedPair step = to_torus(made);
    there = from_torus(step);
    back = from_torus(difference(step, to_torus(local_.displacement(own[0], own[1]))));
  }
  const Float ratio = stepper_.log_density(back) - stepper_.log_density(there);
  return metrofarm::select(stepper_.possible(back), ratio,
                           Float(-std::numeric_limits<float>::infinity()));
}

}  // namespace metrofarm::metropolis
