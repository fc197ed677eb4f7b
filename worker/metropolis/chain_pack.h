// Eight Markov chains side by side. A pack advances its chains together; which chains it has
// depends on their states alone, so rays travel in packets composed alike on every machine.
#pragma once

#include <array>
#include <cstdint>

#include "metropolis/acceptance.h"
#include "metropolis/kernel.h"
#include "metropolis/mutated_sample.h"
#include "metropolis/stays.h"
#include "metropolis/target.h"

namespace metrofarm::metropolis {

// Sums over the large steps of one chain since its start, f in units of c.
struct LargeStepSums {
  uint64_t count = 0;
  double sum = 0;
  double sum_squares = 0;
};

// Proposals of one kind.
struct Tries {
  uint64_t tried = 0, accepted = 0;

  // tried_lanes: bits of lanes, and which of all lanes accepted.
  void add(uint32_t tried_lanes, uint32_t accepted_lanes) {
    tried += __builtin_popcount(tried_lanes);
    accepted += __builtin_popcount(tried_lanes & accepted_lanes);
  }
  Tries& operator+=(const Tries& o) {
    tried += o.tried;
    accepted += o.accepted;
    return *this;
  }
};

struct ChainCounts {
  uint64_t mutations = 0;
  uint64_t evaluations = 0;  // of the target, one for each lane
  uint64_t pairs_read = 0;   // by all evaluations
  Tries large, small;
  Tries subpath;
  Tries second_after_large, second_after_small;
  StayCounts stays;

  ChainCounts& operator+=(const ChainCounts& o) {
    mutations += o.mutations;
    evaluations += o.evaluations;
    pairs_read += o.pairs_read;
    large += o.large;
    small += o.small;
    subpath += o.subpath;
    second_after_large += o.second_after_large;
    second_after_small += o.second_after_small;
    stays += o.stays;
    return *this;
  }
};

struct ChainPackConfig {
  RngKey key;  // of the job's chains
  PackMembers members;
  const Moves& moves;  // outlives the pack
  double unit = 1;     // c
  LayerWeights weights = LayerWeights::kTwoLayer;
};

class ChainPack {
 public:
  // The target's current payload must be that of the chains' states; see state setters below.
  ChainPack(const ChainPackConfig& config, Target& target);

  // Runs n iterations of all eight chains.
  void advance(uint64_t n);
  // Records what the current states have gathered, so that the layers are complete.
  void flush();

  ChainCounts counts() const;
  const std::array<LargeStepSums, kLanes>& large_step_sums() const { return sums_; }

  // Serializable state, beside the target's payload.
  struct State {
    uint64_t iteration = 0;
    uint64_t serial = 0;
    alignas(32) float f[kLanes] = {};
    std::array<LargeStepSums, kLanes> sums;
    Stays::Lengths stays{};
  };
  State state() const;
  // Requires: every f[i] > 0 and restore of every lane's sample.
  void set_state(const State& state);
  MutatedSample& sample() { return sample_; }
  const MutatedSample& sample() const { return sample_; }

 private:
  // What became of one iteration's proposals.
  struct Outcome {
    Steps steps;
    Mask first = no_lanes();         // first proposal accepted
    Mask second_tried = no_lanes();  // never where first is set
    Mask second = no_lanes();        // second proposal accepted
    Float f_y = Float(0.F);
    Float f_z = Float(0.F);
    Float first_acceptance = Float(0.F);
    Float second_acceptance = Float(0.F);  // 0 where not tried
  };

  void iterate();
  Steps steps_of(Float coin) const;
  Float evaluate(Stage stage, Mask lanes);
  Mask wants_second(const Outcome& outcome) const;
  void try_second(Outcome& outcome, Float coin);
  Float judge_second(const Outcome& outcome);
  void record_proposal(const Outcome& outcome);
  void move(const Outcome& outcome);
  void observe(const Outcome& outcome);
  void add_large_steps(Float f_y, uint32_t lanes);

  const DelayedRejection& delayed_;
  LayerScales scales_;
  // Upper ends of the coin's parts that mean a large, an eye and a light step.
  float large_end_, eye_end_, light_end_;
  float inverse_unit_;
  Target& target_;
  MutatedSample sample_;
  uint64_t iteration_ = 0;
  uint64_t serial_ = 0;  // numbers the record() calls, for their dither
  Float f_ = Float(0.F);
  Float weight_ = Float(0.F);  // gathered by the current states and not yet recorded
  ChainCounts counts_;
  Stays stays_;
  std::array<LargeStepSums, kLanes> sums_;
};

}  // namespace metrofarm::metropolis
