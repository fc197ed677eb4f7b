// Uniform samples whose first dimensions are points of scrambled Sobol sequences: each sample is
// uniform by itself, and the samples of one sequence cover the leading pairs evenly.
#pragma once

#include "primary_space/sample_source.h"

namespace metrofarm::primary_space {

// Camera and first surface vertex; later pairs are independent. Owen 1998, "Latin Supercube
// Sampling for Very High-Dimensional Simulations": stratify what matters most, pad the rest.
inline constexpr Slot kStratifiedSlots = light_slot(0, Decision::kLobe);

class StratifiedSource final : public IndependentSource {
 public:
  using IndependentSource::IndependentSource;

  // Begins samples `number` .. + 7: points `first` .. + 7 of one sequence.
  // Requires: first is a multiple of kLanes.
  void begin_points(uint64_t number, uint64_t sequence, uint32_t first);

  // Begins samples `number` .. + 7: point `index` of each of sequences `sequence` .. + 7.
  void begin_sequences(uint64_t number, uint64_t sequence, uint32_t index);

 private:
  FixedPair fixed_pair(Slot slot) const override;
  UInt reversed_word(int dimension) const;

  UInt sequence_low_ = UInt(0U);
  UInt sequence_high_ = UInt(0U);
  uint32_t index_ = 0;
  bool consecutive_ = false;  // lane i is point index_ + i, else all are point index_
};

}  // namespace metrofarm::primary_space
