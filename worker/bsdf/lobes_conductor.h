// Metals.
#pragma once

#include "bsdf/parameters.h"
#include "bsdf/types.h"

namespace metrofarm::bsdf {

// Perfect mirror.
struct ConductorLobe {
  static constexpr int kEta = 0, kK = 3, kReflectance = 6, kColumns = 9;

  static Row row(const scene::Conductor& c);
  static Evaluation evaluate(const Parameters&, Mask, const Vec3&, const Vec3&, Transport) {
    return {};
  }
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

// Torrance-Sparrow reflection, Walter et al. 2007 eq. 20, separable Smith masking.
template <class Distribution>
struct RoughConductorLobe {
  static constexpr int kEta = 0, kK = 3, kReflectance = 6, kAlphaU = 9, kAlphaV = 10;
  static constexpr int kColumns = 11;

  static Row row(const scene::RoughConductor& c);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

}  // namespace metrofarm::bsdf
