// Microfacet normal distributions, anisotropic, around +z.
//
// GGX: Walter et al. 2007; its visible normals are sampled by Dupuy and Benyoub 2023, "Sampling
// Visible GGX Normals with Spherical Caps", listing 3. Beckmann: Walter et al. 2007, with the whole
// distribution sampled by its slopes and the rational approximation of Smith's function (eq. 27).
#pragma once

#include "math/warp.h"

namespace metrofarm::bsdf {

struct Roughness {
  Float alpha_u, alpha_v;
};

struct Ggx {
  // Density of normals; integrates cos_theta D to 1.
  static Float distribution(const Vec3& m, const Roughness& a) {
    const Float e = sqr(m.x / a.alpha_u) + sqr(m.y / a.alpha_v) + sqr(m.z);
    return Float(1.F) / (Float(kPi) * a.alpha_u * a.alpha_v * sqr(e));
  }

  // Smith's masking of direction v.
  static Float masking(const Vec3& v, const Roughness& a) {
    const Float tan2_alpha2 = (sqr(v.x * a.alpha_u) + sqr(v.y * a.alpha_v)) / sqr(v.z);
    return Float(2.F) / (Float(1.F) + xsimd::sqrt(Float(1.F) + tan2_alpha2));
  }

  // A normal visible from wo. Requires: wo.z > 0.
  static Vec3 sample_normal(const Vec3& wo, Vec2 u, const Roughness& a) {
    const Vec3 stretched = normalize(Vec3{wo.x * a.alpha_u, wo.y * a.alpha_v, wo.z});
    const Float z = (Float(1.F) - u.x) * (Float(1.F) + stretched.z) - stretched.z;
    const Float r = safe_sqrt(Float(1.F) - z * z);
    const SinCos turn = sincos_turn(u.y);
    const Vec3 half = Vec3{r * turn.cos, r * turn.sin, z} + stretched;
    return normalize(Vec3{half.x * a.alpha_u, half.y * a.alpha_v, half.z});
  }

  // pdf_solid_angle of sample_normal, over normals.
  static Float pdf_normal(const Vec3& wo, const Vec3& m, const Roughness& a) {
    return masking(wo, a) * xsimd::max(dot(wo, m), Float(0.F)) * distribution(m, a) / wo.z;
  }
};

struct Beckmann {
  static Float distribution(const Vec3& m, const Roughness& a) {
    const Float cos2 = sqr(m.z);
    const Float exponent = (sqr(m.x / a.alpha_u) + sqr(m.y / a.alpha_v)) / cos2;
    const Float d = xsimd::exp(-exponent) / (Float(kPi) * a.alpha_u * a.alpha_v * sqr(cos2));
    return keep(m.z > Float(0.F), d);
  }

  static Float masking(const Vec3& v, const Roughness& a) {
    const Float tan_alpha =
        xsimd::sqrt(sqr(v.x * a.alpha_u) + sqr(v.y * a.alpha_v)) / xsimd::abs(v.z);
    const Float c = Float(1.F) / tan_alpha;
    const Float c2 = c * c;
    const Float g = (Float(3.535F) * c + Float(2.181F) * c2) /
                    (Float(1.F) + Float(2.276F) * c + Float(2.577F) * c2);
    return select(c < Float(1.6F), g, Float(1.F));
  }

  static Vec3 sample_normal(const Vec3& /*wo*/, Vec2 u, const Roughness& a) {
    const Float r = safe_sqrt(-xsimd::log(Float(1.F) - u.x));
    const SinCos turn = sincos_turn(u.y);
    return normalize(Vec3{a.alpha_u * r * turn.cos, a.alpha_v * r * turn.sin, Float(1.F)});
  }

  static Float pdf_normal(const Vec3& /*wo*/, const Vec3& m, const Roughness& a) {
    return distribution(m, a) * m.z;
  }
};

}  // namespace metrofarm::bsdf
