// Boundaries between dielectrics. Refraction scales radiance by 1 / eta^2.
#pragma once

#include "bsdf/parameters.h"
#include "bsdf/types.h"

namespace metrofarm::bsdf {

struct DielectricLobe {
  static constexpr int kEta = 0, kReflectance = 1, kTransmittance = 4, kColumns = 7;

  static Row row(const scene::Dielectric& d);
  static Evaluation evaluate(const Parameters&, Mask, const Vec3&, const Vec3&, Transport) {
    return {};
  }
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

struct ThinDielectricLobe {
  static constexpr int kEta = 0, kReflectance = 1, kTransmittance = 4, kColumns = 7;

  static Row row(const scene::ThinDielectric& d);
  static Evaluation evaluate(const Parameters&, Mask, const Vec3&, const Vec3&, Transport) {
    return {};
  }
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

// Walter et al. 2007, eq. 20 and 21, separable Smith masking.
template <class Distribution>
struct RoughDielectricLobe {
  static constexpr int kEta = 0, kReflectance = 1, kTransmittance = 4, kAlphaU = 7, kAlphaV = 8;
  static constexpr int kColumns = 9;

  static Row row(const scene::RoughDielectric& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

}  // namespace metrofarm::bsdf
