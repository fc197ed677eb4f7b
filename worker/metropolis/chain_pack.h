// Eight Markov chains side by side: the unit of determinism. A pack always holds the same chains
// and advances them together, so rays travel in packets composed alike on every machine.
#pragma once

#include <array>
#include <cstdint>

#include "metropolis/acceptance.h"
#include "metropolis/kernel.h"
#include "metropolis/mutated_sample.h"
#include "metropolis/target.h"

namespace metrofarm::metropolis {

// Sums over the large steps of one chain since its start, f in units of c.
struct LargeStepSums {
  uint64_t count = 0;
  double sum = 0;
  double sum_squares = 0;
};

struct ChainCounts {
  uint64_t mutations = 0;
  uint64_t large_steps = 0, large_accepted = 0;
  uint64_t small_steps = 0, small_accepted = 0;

  ChainCounts& operator+=(const ChainCounts& o) {
    mutations += o.mutations;
    large_steps += o.large_steps;
    large_accepted += o.large_accepted;
    small_steps += o.small_steps;
    small_accepted += o.small_accepted;
    return *this;
  }
};

struct ChainPackConfig {
  RngKey key;            // of the job's chains
  uint32_t first_chain;  // lane i runs chain first_chain + i
  Kernel kernel;
  double unit = 1;  // c
};

class ChainPack {
 public:
  // The target's current payload must be that of the chains' states; see state setters below.
  ChainPack(const ChainPackConfig& config, Target& target);

  // Runs n iterations of all eight chains.
  void advance(uint64_t n);
  // Records what the current states have gathered, so that the layers are complete.
  void flush();

  const ChainCounts& counts() const { return counts_; }
  const std::array<LargeStepSums, kLanes>& large_step_sums() const { return sums_; }

  // Serializable state, beside the target's payload.
  struct State {
    uint64_t iteration = 0;
    uint64_t serial = 0;
    alignas(32) float f[kLanes] = {};
    std::array<LargeStepSums, kLanes> sums;
  };
  State state() const;
  // Requires: every f[i] > 0 and restore of every lane's sample.
  void set_state(const State& state);
  MutatedSample& sample() { return sample_; }
  const MutatedSample& sample() const { return sample_; }

 private:
  void iterate();
  void record_large_steps(Float f_y, Mask large);
  void observe(Mask large, Mask accepted, Float f_y);

  LayerScales scales_;
  float large_step_probability_;
  float inverse_unit_;
  Target& target_;
  MutatedSample sample_;
  uint64_t iteration_ = 0;
  uint64_t serial_ = 0;  // numbers the record() calls, for their dither
  Float f_ = Float(0.F);
  Float weight_ = Float(0.F);  // gathered by the current states and not yet recorded
  ChainCounts counts_;
  std::array<LargeStepSums, kLanes> sums_;
};

}  // namespace metrofarm::metropolis
