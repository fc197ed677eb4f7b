// Independent samples before the chains: their mean is b, and chains start from them.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "metropolis/target.h"
#include "primary_space/stratified_source.h"

namespace metrofarm::burn_in {

// Evaluates the eight consecutive samples that begin at `first`, a multiple of kLanes. The same
// eight always travel together, so that a sample's value does not depend on who asks for it.
class Bootstrap {
 public:
  // samples: size of the whole bootstrap, an even multiple of kLanes.
  // lengths: where paths are multiplexed, coordinates that draw each length; eight samples after
  // the other take them in turn.
  Bootstrap(uint64_t job_seed, uint64_t samples, metropolis::Target& target,
            std::vector<uint32_t> lengths = {})
      : source_(rng_key(job_seed, RngDomain::kBootstrap)),
        half_(samples / 2),
        target_(target),
        lengths_(std::move(lengths)) {}

  // f of each sample; their payloads are the target's proposals until the next evaluation.
  Float evaluate(uint64_t first) {
    // A sequence for each half: the halves stay independent, as the error estimate takes them to
    // be. And one for each length: every n-th point of a sequence is no even cover.
    const uint64_t half = first / half_, in_half = first % half_;
    if (lengths_.empty()) {
      source_.begin_points(first, half, static_cast<uint32_t>(in_half));
    } else {
      const size_t length = length_index(first);
      const uint64_t turn = in_half / kLanes / lengths_.size();
      source_.begin_points(first, half * lengths_.size() + length,
                           static_cast<uint32_t>(turn * kLanes));
      source_.pin(primary_space::kTechniqueSlot, lengths_[length]);
    }
    return target_.evaluate(source_, metropolis::Which::kProposal, all_lanes());
  }

  // Which of the lengths samples first .. first + 7 have. Requires: paths are multiplexed.
  size_t length_index(uint64_t first) const { return first / kLanes % lengths_.size(); }

  // Pairs that one of the last eight samples has read: the state of a chain that starts there.
  std::vector<primary_space::StoredPair> pairs(int lane) const { return source_.read_pairs(lane); }

 private:
  primary_space::StratifiedSource source_;
  uint64_t half_;
  metropolis::Target& target_;
  std::vector<uint32_t> lengths_;
};

}  // namespace metrofarm::burn_in
