// Small-step kernels: how far a pair of coordinates moves on the torus. All are symmetric, so they
// cancel from the acceptance ratio of a first stage.
#pragma once

#include "primary_space/sample_source.h"

namespace metrofarm::metropolis {

enum class KernelKind { kKelemenPair, kGaussian, kKelemenCoordinate, kWrappedCauchy, kUniform };

// Lengths are shares of the torus.
struct Kernel {
  KernelKind kind = KernelKind::kKelemenPair;
  // Radius of kKelemenPair, distance of kKelemenCoordinate: s2 exp(-ln(s2 / s1) xi) (Kelemen et al.
  // 2002, section 3.2).
  double s1 = 1.9 / 1024;
  double s2 = 1.9 / 64;
  double sigma = 0.01;  // kGaussian: standard deviation per coordinate
  double large_step_probability = 0.3;
  double scale = 0.005;      // kWrappedCauchy: the unwrapped law's half width at half maximum
  double half_width = 0.01;  // kUniform: largest distance
  // Steps that draw one subpath anew and keep the other.
  double eye_step_probability = 0;
  double light_step_probability = 0;
};

// Whether the law of a pair's displacement depends on its length alone.
constexpr bool is_isotropic(KernelKind kind) {
  return kind == KernelKind::kKelemenPair || kind == KernelKind::kGaussian;
}

// The same kernel with all its lengths multiplied.
Kernel scaled(Kernel kernel, double factor);

// A displacement as it was made, before it is wrapped.
struct Displacement {
  Float first, second;
};

// To fixed point modulo 1.
inline UInt to_torus(Float displacement) {
  const Float wrapped = displacement - xsimd::nearbyint(displacement);
  // +0.5 becomes -2^31, the same point.
  return as_uint(Int(_mm256_cvtps_epi32(wrapped * Float(0x1p32F))));
}
inline primary_space::FixedPair to_torus(const Displacement& d) {
  return {to_torus(d.first), to_torus(d.second)};
}
// The shortest displacement that leads there.
Displacement from_torus(const primary_space::FixedPair& d);

// Displaces pairs by one kernel, from two uniform words per lane.
class Stepper {
 public:
  explicit Stepper(const Kernel& kernel);

  Displacement displacement(UInt word0, UInt word1) const;
  // The same displacement turned by `angle`, in units of 2^-32 turns. Under an isotropic kernel it
  // is the displacement of (word0, word1 + angle), bit by bit: turning it back is exact.
  Displacement turned(UInt word0, UInt word1, UInt angle) const;

  primary_space::FixedPair step(const primary_space::FixedPair& from, UInt word0, UInt word1) const;

  bool isotropic() const { return is_isotropic(kind_); }
  // Whether the kernel can make displacement d; its components in [-1/2, 1/2] or beyond.
  Mask possible(const Displacement& d) const;
  // ln of the density on the torus at a possible d, up to a constant.
  Float log_density(const Displacement& d) const;

 private:
  Float one_coordinate(UInt word) const;
  Float log_density_of_one(Float d) const;

  KernelKind kind_;
  float s1_, s2_;
  float log_ratio_;  // ln(s2 / s1)
  float sigma_;
  float half_width_;
  float spread_;        // kWrappedCauchy: (1 - rho) / (1 + rho) with rho = exp(-2 pi scale)
  float cauchy_floor_;  // kWrappedCauchy: (1 - rho)^2 / (4 rho)
};

}  // namespace metrofarm::metropolis
