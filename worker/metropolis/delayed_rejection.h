// What follows a rejected proposal y: a second, timid proposal z (Tierney and Mira 1999; Green and
// Mira 2001; Rioux-Lavoie et al. 2020, "Delayed Rejection Metropolis Light Transport").
#pragma once

#include <optional>
#include <vector>

#include "base/result.h"
#include "metropolis/kernel.h"

namespace metrofarm::metropolis {

// Where z lies.
enum class SecondMove {
  kNone,
  kOrbital,  // x turned around y, pair by pair
  kLocal     // a scaled step of the kernel from x, independent of y
};

// Law of the angle of an orbital move.
enum class AngleLaw { kWrappedCauchy, kVonMises };

enum class AcceptanceRule {
  kOrbital,      // the first stage's density cancels
  kTierneyMira,  // the ratio of the first stage's densities
  kGreenMira     // the first stage reversed from z, a third evaluation
};

struct DelayedRejection {
  SecondMove move = SecondMove::kNone;
  AngleLaw angle_law = AngleLaw::kWrappedCauchy;
  // kWrappedCauchy: mean resultant length rho in [0, 1); kVonMises: kappa in [0, 10000].
  double concentration = 0.7788007830714049;  // exp(-1/4)
  AcceptanceRule rule = AcceptanceRule::kOrbital;
  // Of local moves, relative to the first stage's kernel.
  double local_scale = 0.25;
  // Rejected large steps have a second stage too: a local move.
  bool after_large_steps = false;

  bool enabled() const { return move != SecondMove::kNone || after_large_steps; }
};

// Coordinates of a pair that small steps keep and large steps draw.
struct FrozenPair {
  primary_space::Slot slot;
  bool first, second;
};

// All that proposals are made from.
struct Proposals {
  Kernel kernel;
  DelayedRejection delayed_rejection;
  std::vector<FrozenPair> frozen;
};

// What is wrong: a size out of range, or a combination that would not keep detailed balance.
std::optional<Error> problem_with(const Proposals& proposals);

}  // namespace metrofarm::metropolis
