#include "metropolis/angle_table.h"

#include <cmath>
#include <numbers>

namespace metrofarm::metropolis {
namespace {

using std::numbers::pi;

// |angle| / (2 pi) = atan((1 - rho) / (1 + rho) tan(pi q / 2)) / pi.
void fill_wrapped_cauchy(double rho, float* quantile, int cells) {
  const double spread = (1 - rho) / (1 + rho);
  for (int i = 0; i < cells; ++i)
    quantile[i] = static_cast<float>(std::atan(spread * std::tan(0.5 * pi * i / cells)) / pi);
  quantile[cells] = 0.5F;
}

// Density exp(kappa cos t), summed by the midpoint rule up to where it is e^-8 of its largest.
void fill_von_mises(double kappa, float* quantile, int cells) {
  constexpr int kSteps = 16384;
  const double end = kappa > 4 ? std::acos(1 - 8 / kappa) : pi;
  const double step = end / kSteps;
  const auto density = [&](int i) { return std::exp(kappa * (std::cos((i + 0.5) * step) - 1)); };
  double total = 0;
  for (int i = 0; i < kSteps; ++i) total += density(i);
  double below = 0;
  int at = 0;
  for (int i = 0; i < cells; ++i) {
    const double wanted = total * i / cells;
    while (below + density(at) <= wanted) below += density(at++);
    quantile[i] = static_cast<float>((at + (wanted - below) / density(at)) * step / (2 * pi));
  }
  quantile[cells] = static_cast<float>(end / (2 * pi));
}

}  // namespace

AngleTable::AngleTable(AngleLaw law, double concentration) {
  if (law == AngleLaw::kWrappedCauchy) {
    fill_wrapped_cauchy(concentration, quantile_.data(), kCells);
  } else {
    fill_von_mises(concentration, quantile_.data(), kCells);
  }
}

UInt AngleTable::angle(UInt word) const {
  const Float at = unit_float(word) * Float(static_cast<float>(kCells));
  const Int cell = truncate(at);
  const Float low = gather(quantile_.data(), cell, all_lanes());
  const Float high = gather(quantile_.data(), cell + Int(1), all_lanes());
  const Float turns = low + (at - to_float(cell)) * (high - low);
  // Half a turn becomes -2^31, which is its own opposite.
  const UInt magnitude = as_uint(Int(_mm256_cvtps_epi32(turns * Float(0x1p32F))));
  // The lowest bit has no share in unit_float().
  const Mask negative = equal(as_int(word & UInt(1U)), Int(1));
  return select(negative, UInt(0U) - magnitude, magnitude);
}

}  // namespace metrofarm::metropolis
