// Independent samples before the chains: their mean is b, and chains start from them.
#pragma once

#include <cstdint>

#include "metropolis/target.h"
#include "primary_space/stratified_source.h"

namespace metrofarm::burn_in {

// Evaluates the eight consecutive samples that begin at `first`, a multiple of kLanes. The same
// eight always travel together, so that a sample's value does not depend on who asks for it.
class Bootstrap {
 public:
  // samples: size of the whole bootstrap, an even multiple of kLanes.
  Bootstrap(uint64_t job_seed, uint64_t samples, metropolis::Target& target)
      : source_(rng_key(job_seed, RngDomain::kBootstrap)), half_(samples / 2), target_(target) {}

  // f of each sample; their payloads are the target's proposals until the next evaluation.
  Float evaluate(uint64_t first) {
    // A sequence for each half: the halves stay independent, as the error estimate takes them to
    // be.
    source_.begin_points(first, first / half_, static_cast<uint32_t>(first % half_));
    return target_.evaluate(source_, metropolis::Which::kProposal, all_lanes());
  }

  // Pairs that one of the last eight samples has read: the state of a chain that starts there.
  std::vector<primary_space::StoredPair> pairs(int lane) const { return source_.read_pairs(lane); }

 private:
  primary_space::StratifiedSource source_;
  uint64_t half_;
  metropolis::Target& target_;
};

}  // namespace metrofarm::burn_in
