// A diffuse base under a dielectric coating, as in Mitsuba: light that enters the coating is
// scattered back by the base, any number of times, and leaves diffusely.
#pragma once

#include "bsdf/parameters.h"
#include "bsdf/rough_transmittance.h"
#include "bsdf/types.h"

namespace metrofarm::bsdf {

// Smooth coating: a mirror (delta) and a diffuse part.
struct PlasticLobe {
  static constexpr int kDiffuse = 0, kSpecular = 3, kEta = 6, kInternal = 7, kNonlinear = 8;
  static constexpr int kColumns = 9;

  static Row row(const scene::Plastic& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

template <class Distribution>
struct RoughPlasticLobe {
  static constexpr int kDiffuse = 0, kSpecular = 3, kEta = 6, kInternal = 7, kNonlinear = 8;
  static constexpr int kAlpha = 9, kTable = 10, kColumns = 11;

  static Row row(const scene::RoughPlastic& d, TransmittanceTables& tables);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

}  // namespace metrofarm::bsdf
