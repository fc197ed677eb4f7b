#include "metropolis/kernel.h"

#include <cmath>
#include <numbers>

#include "math/warp.h"

namespace metrofarm::metropolis {

using primary_space::FixedPair;

namespace {

UInt to_torus(Float displacement) {
  const Float wrapped = displacement - xsimd::nearbyint(displacement);
  // +0.5 becomes -2^31, the same point.
  return as_uint(Int(_mm256_cvtps_epi32(wrapped * Float(0x1p32F))));
}

Float from_torus(UInt displacement) {
  return to_float(as_int(displacement)) * Float(0x1p-32F);
}

// In (0, 1) and symmetric about its middle: keeps logarithms and tangents finite.
Float open_unit_float(UInt word) {
  return unit_float(word) + Float(0x1p-25F);
}

// The lowest bit, which unit_float() does not look at.
Mask coin(UInt word) {
  return equal(as_int(word & UInt(1U)), Int(1));
}

Float length_squared(const Displacement& d) {
  return sqr(d.first) + sqr(d.second);
}

Mask between(Float low, Float x, Float high) {
  return (x > low) & (x <= high);
}

}  // namespace

FixedPair to_torus(const Displacement& d) {
  return {to_torus(d.first), to_torus(d.second)};
}

Displacement from_torus(const FixedPair& d) {
  return {from_torus(d.first), from_torus(d.second)};
}

Kernel scaled(Kernel kernel, double factor) {
  for (double* length : {&kernel.s1, &kernel.s2, &kernel.sigma, &kernel.scale, &kernel.half_width})
    *length *= factor;
  return kernel;
}

Stepper::Stepper(const Kernel& kernel)
    : kind_(kernel.kind),
      s1_(static_cast<float>(kernel.s1)),
      s2_(static_cast<float>(kernel.s2)),
      log_ratio_(static_cast<float>(std::log(kernel.s2 / kernel.s1))),
      sigma_(static_cast<float>(kernel.sigma)),
      half_width_(static_cast<float>(kernel.half_width)),
      spread_(static_cast<float>(std::tanh(std::numbers::pi * kernel.scale))),
      cauchy_floor_(static_cast<float>(std::pow(std::sinh(std::numbers::pi * kernel.scale), 2))) {}

Float Stepper::one_coordinate(UInt word) const {
  if (kind_ == KernelKind::kUniform)
    return Float(half_width_) * (Float(2.F) * open_unit_float(word) - Float(1.F));
  if (kind_ == KernelKind::kKelemenCoordinate) {
    const Float distance = Float(s2_) * xsimd::exp(Float(-log_ratio_) * unit_float(word));
    return select(coin(word), -distance, distance);
  }
  // Wrapped Cauchy: atan(spread tan(pi (xi - 1/2))) / pi, the Moebius transform of a uniform angle
  // (McCullagh 1996, "Moebius transformation and Cauchy parameter estimation", section 2).
  const SinCos a = sincos_turn(Float(0.5F) * open_unit_float(word));
  return Float(-kInvPi) * xsimd::atan(Float(spread_) * a.cos / a.sin);
}

Displacement Stepper::displacement(UInt word0, UInt word1) const {
  if (!isotropic()) return {one_coordinate(word0), one_coordinate(word1)};
  const Float xi = unit_float(word0);
  const Float radius =
      kind_ == KernelKind::kKelemenPair
          ? Float(s2_) * xsimd::exp(Float(-log_ratio_) * xi)
          // Box and Muller; half a unit in the last place keeps the logarithm finite.
          : Float(sigma_) * xsimd::sqrt(Float(-2.F) * xsimd::log(xi + Float(0x1p-25F)));
  const SinCos angle = sincos_turn(unit_float(word1));
  return {radius * angle.cos, radius * angle.sin};
}

Displacement Stepper::turned(UInt word0, UInt word1, UInt angle) const {
  if (isotropic()) return displacement(word0, word1 + angle);
  const Displacement d = displacement(word0, word1);
  const SinCos a = sincos_turn(unit_float(angle));
  return {a.cos * d.first - a.sin * d.second, a.sin * d.first + a.cos * d.second};
}

FixedPair Stepper::step(const FixedPair& from, UInt word0, UInt word1) const {
  const FixedPair d = metropolis::to_torus(displacement(word0, word1));
  return {from.first + d.first, from.second + d.second};
}

Mask Stepper::possible(const Displacement& d) const {
  const Float x = xsimd::abs(d.first), y = xsimd::abs(d.second);
  switch (kind_) {
    case KernelKind::kKelemenPair:
      return between(Float(s1_ * s1_), length_squared(d), Float(s2_ * s2_));
    case KernelKind::kGaussian:
      return all_lanes();
    case KernelKind::kKelemenCoordinate:
      return between(Float(s1_), x, Float(s2_)) & between(Float(s1_), y, Float(s2_));
    case KernelKind::kWrappedCauchy:
      return (x <= Float(0.5F)) & (y <= Float(0.5F));
    case KernelKind::kUniform:
      return (x <= Float(half_width_)) & (y <= Float(half_width_));
  }
  return no_lanes();
}

// Of the kernels whose coordinates are independent.
Float Stepper::log_density_of_one(Float d) const {
  if (kind_ == KernelKind::kGaussian) {
    // The nearest three images; sigma < 1/4 leaves less than 1e-7 to the others.
    const float k = 0.5F / (sigma_ * sigma_);
    const Float images = xsimd::exp(Float(-k) * (Float(1.F) + Float(2.F) * d)) +
                         xsimd::exp(Float(-k) * (Float(1.F) - Float(2.F) * d));
    return Float(-k) * sqr(d) + xsimd::log(Float(1.F) + images);
  }
  if (kind_ == KernelKind::kKelemenCoordinate) return -xsimd::log(xsimd::abs(d));
  // Wrapped Cauchy: 1 / ((1 - rho)^2 + 4 rho sin^2(pi d)), without the difference of near equals.
  const SinCos a = sincos_turn(Float(0.5F) * xsimd::abs(d));
  return -xsimd::log(Float(cauchy_floor_) + sqr(a.sin));
}

Float Stepper::log_density(const Displacement& d) const {
  if (kind_ == KernelKind::kKelemenPair) return -xsimd::log(length_squared(d));
  if (kind_ == KernelKind::kUniform) return Float(0.F);
  return log_density_of_one(d.first) + log_density_of_one(d.second);
}

}  // namespace metrofarm::metropolis
