// Symmetric laws of an angle, by a table of their quantiles. Between its points a law is only
// approximated (the outermost 1/1024 is spread evenly), but the angles t and -t are exactly equally
// likely, and no more is needed for detailed balance.
#pragma once

#include <array>

#include "metropolis/delayed_rejection.h"

namespace metrofarm::metropolis {

class AngleTable {
 public:
  AngleTable(AngleLaw law, double concentration);

  // An angle in units of 2^-32 turns from a uniform word.
  UInt angle(UInt word) const;

 private:
  static constexpr int kCells = 1024;

  // Quantiles of the absolute angle, in turns: [0, 1/2].
  std::array<float, kCells + 1> quantile_;
};

}  // namespace metrofarm::metropolis
