// Modified Phong reflection (Lafortune and Willems 1994) over a diffuse base.
#pragma once

#include "bsdf/parameters.h"
#include "bsdf/types.h"

namespace metrofarm::bsdf {

struct PhongLobe {
  static constexpr int kDiffuse = 0, kSpecular = 3, kExponent = 6, kColumns = 7;

  // Where both reflectances add up to more than 1 in some channel, both are scaled down to 0.99
  // (Mitsuba 0.6, ensureEnergyConservation); textures count as their factor.
  static Row row(const scene::Phong& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

}  // namespace metrofarm::bsdf
