// Disney's principled BSDF (Burley 2012 and 2015) with the parameters and lobes of Mitsuba 3.
#pragma once

#include "bsdf/parameters.h"
#include "bsdf/types.h"

namespace metrofarm::bsdf {

struct PrincipledLobe {
  static constexpr int kBase = 0, kRoughness = 3, kAnisotropic = 4, kMetallic = 5, kSpecTrans = 6;
  static constexpr int kSpecTint = 7, kSheen = 8, kSheenTint = 9, kFlatness = 10, kClearcoat = 11;
  static constexpr int kGloss = 12, kEta = 13, kSpecularRate = 14, kClearcoatRate = 15;
  static constexpr int kDiffuseRate = 16, kColumns = 17;

  static Row row(const scene::Principled& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

// For thin sheets: no refraction, and light passes diffusely too.
struct PrincipledThinLobe {
  static constexpr int kBase = 0, kRoughness = 3, kAnisotropic = 4, kSpecTrans = 5, kDiffTrans = 6;
  static constexpr int kSpecTint = 7, kSheen = 8, kSheenTint = 9, kFlatness = 10, kEta = 11;
  static constexpr int kSpecReflectRate = 12, kSpecTransmitRate = 13, kDiffuseReflectRate = 14;
  static constexpr int kDiffuseTransmitRate = 15, kColumns = 16;

  static Row row(const scene::PrincipledThin& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

}  // namespace metrofarm::bsdf
