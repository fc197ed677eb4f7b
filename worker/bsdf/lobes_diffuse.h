// Lambertian reflection and transmission, and the surface that is not there.
#pragma once

#include "bsdf/parameters.h"
#include "bsdf/types.h"

namespace metrofarm::bsdf {

struct DiffuseLobe {
  static constexpr int kReflectance = 0, kColumns = 3;

  static Row row(const scene::Diffuse& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

// To the other side only.
struct DiffuseTransmitterLobe {
  static constexpr int kTransmittance = 0, kColumns = 3;

  static Row row(const scene::DiffuseTransmitter& d);
  static Evaluation evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                             Transport transport);
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

// Straight through.
struct NullLobe {
  static constexpr int kColumns = 0;

  static Evaluation evaluate(const Parameters&, Mask, const Vec3&, const Vec3&, Transport) {
    return {};
  }
  static Sample sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                       Transport transport);
};

}  // namespace metrofarm::bsdf
