#include "metropolis/kernel.h"

#include <cmath>

#include "math/warp.h"

namespace metrofarm::metropolis {
namespace {

// A displacement in units of the torus, to fixed point modulo 1.
UInt to_torus(Float displacement) {
  const Float wrapped = displacement - xsimd::nearbyint(displacement);
  // +0.5 becomes -2^31, the same point.
  return as_uint(Int(_mm256_cvtps_epi32(wrapped * Float(0x1p32F))));
}

}  // namespace

Stepper::Stepper(const Kernel& kernel)
    : kind_(kernel.kind),
      s2_(static_cast<float>(kernel.s2)),
      log_ratio_(static_cast<float>(std::log(kernel.s2 / kernel.s1))),
      sigma_(static_cast<float>(kernel.sigma)) {}

primary_space::FixedPair Stepper::step(const primary_space::FixedPair& from, UInt word0,
                                       UInt word1) const {
  const Float xi = unit_float(word0);
  const Float radius =
      kind_ == KernelKind::kKelemenPair
          ? Float(s2_) * xsimd::exp(Float(-log_ratio_) * xi)
          // Box and Muller; half a unit in the last place keeps the logarithm finite.
          : Float(sigma_) * xsimd::sqrt(Float(-2.F) * xsimd::log(xi + Float(0x1p-25F)));
  const SinCos angle = sincos_turn(unit_float(word1));
  return {from.first + to_torus(radius * angle.cos), from.second + to_torus(radius * angle.sin)};
}

}  // namespace metrofarm::metropolis
