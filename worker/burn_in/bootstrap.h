// Independent samples before the chains: their mean is b, and chains start from them.
#pragma once

#include <cstdint>

#include "metropolis/target.h"
#include "primary_space/sample_source.h"

namespace metrofarm::burn_in {

// Evaluates the eight consecutive samples that begin at `first`, a multiple of kLanes. The same
// eight always travel together, so that a sample's value does not depend on who asks for it.
class Bootstrap {
 public:
  Bootstrap(uint64_t job_seed, metropolis::Target& target)
      : source_(rng_key(job_seed, RngDomain::kBootstrap)), target_(target) {}

  // f of each sample; their payloads are the target's proposals until the next evaluation.
  Float evaluate(uint64_t first) {
    source_.begin(first);
    return target_.evaluate(source_);
  }

  // Pairs that one of the last eight samples has read: the state of a chain that starts there.
  std::vector<primary_space::StoredPair> pairs(int lane) const { return source_.read_pairs(lane); }

 private:
  primary_space::IndependentSource source_;
  metropolis::Target& target_;
};

}  // namespace metrofarm::burn_in
