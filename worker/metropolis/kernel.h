// Small-step kernels: how far a pair of coordinates moves on the torus. Both kernels are symmetric
// and isotropic in a pair, so they cancel from the acceptance ratio and a second stage that rotates
// a pair around its proposal stays valid.
#pragma once

#include "primary_space/sample_source.h"

namespace metrofarm::metropolis {

enum class KernelKind { kKelemenPair, kGaussian };

struct Kernel {
  KernelKind kind = KernelKind::kKelemenPair;
  double s1 =
      1.9 / 1024;  // kKelemenPair: radius s2 exp(-ln(s2 / s1) xi) (Kelemen et al. 2002, 3.2)
  double s2 = 1.9 / 64;
  double sigma = 0.01;  // kGaussian: standard deviation per coordinate
  double large_step_probability = 0.3;
};

// Displaces pairs by one kernel, from two uniform words per lane.
class Stepper {
 public:
  explicit Stepper(const Kernel& kernel);

  primary_space::FixedPair step(const primary_space::FixedPair& from, UInt word0, UInt word1) const;

 private:
  KernelKind kind_;
  float s2_;
  float log_ratio_;  // ln(s2 / s1)
  float sigma_;
};

}  // namespace metrofarm::metropolis
