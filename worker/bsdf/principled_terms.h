// Terms that both principled models are made of. Burley 2012: "Physically Based Shading at Disney";
// Burley 2015: "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering".
#pragma once

#include "bsdf/microfacet.h"
#include "spectrum/rgb.h"

namespace metrofarm::bsdf {

inline Float mix(Float a, Float b, Float t) {
  return a + (b - a) * t;
}
inline Spectrum mix(const Spectrum& a, const Spectrum& b, Float t) {
  return a + (b - a) * t;
}

// (1 - cos)^5, Schlick 1994.
inline Float schlick_weight(Float cosine) {
  const Float m = Float(1.F) - xsimd::min(cosine, Float(1.F));
  return sqr(sqr(m)) * m;
}

// Schlick's weight for incidence from the side of lower index, by the refracted angle from the
// other. eta: index on the far side over index on the side of incidence.
inline Float schlick_weight(Float cosine, Float eta) {
  const Float cos2_t = Float(1.F) - (Float(1.F) - sqr(cosine)) / sqr(eta);
  return schlick_weight(select(eta > Float(1.F), cosine, safe_sqrt(cos2_t)));
}

inline Spectrum schlick(const Spectrum& at_normal, Float weight) {
  return at_normal + (splat(1.F) - at_normal) * weight;
}

// The hue of a colour: luminance 1, white for black.
inline Spectrum tint_of(const Spectrum& base) {
  const Float y = luminance(base);
  return select(y > Float(0.F), base / y, splat(1.F));
}

// Reflectance at normal incidence of a boundary.
inline Float normal_reflectance(Float eta) {
  return sqr((eta - Float(1.F)) / (eta + Float(1.F)));
}

// Burley 2012, section 5.4.
inline Roughness principled_roughness(Float rough, Float anisotropic) {
  const Float rough2 = sqr(rough);
  const Float aspect = safe_sqrt(Float(1.F) - Float(0.9F) * anisotropic);
  return {xsimd::max(rough2 / aspect, Float(0.001F)), xsimd::max(rough2 * aspect, Float(0.001F))};
}

// Diffuse, retro-reflective and flattened parts for a base of colour 1 (Burley 2012, section 5.3;
// 2015, section 5), and the weight of sheen; both without the cosine.
struct DiffuseTerms {
  // cos_d: between either direction and the half vector.
  DiffuseTerms(Float cos_o, Float cos_i, Float cos_d, Float rough, Float flatness) {
    const Float f_o = schlick_weight(cos_o), f_i = schlick_weight(cos_i);
    const Float half(0.5F), one(1.F);
    const Float plain = (one - half * f_o) * (one - half * f_i);
    const Float r = Float(2.F) * rough * sqr(cos_d);
    const Float retro = r * (f_o + f_i + f_o * f_i * (r - one));
    const Float ss90 = half * r;
    const Float ss = mix(one, ss90, f_o) * mix(one, ss90, f_i);
    const Float flat = Float(1.25F) * (ss * (one / (cos_o + cos_i) - half) + half);
    diffuse = mix(plain + retro, flat, flatness) * Float(kInvPi);
    sheen = schlick_weight(xsimd::abs(cos_d));
  }

  Float diffuse, sheen;
};

// Generalized Trowbridge-Reitz distribution with exponent 1 (Burley 2012, eq. 4 and appendix B.2),
// isotropic. Written in the sine, so that narrow lobes keep their digits.
struct Gtr1 {
  Float alpha2;

  explicit Gtr1(Float gloss) : alpha2(sqr(mix(Float(0.1F), Float(0.001F), gloss))) {}

  Float distribution(const Vec3& m) const {
    const Float spread = sqr(m.x) + sqr(m.y) + alpha2 * sqr(m.z);
    return (alpha2 - Float(1.F)) / (Float(kPi) * xsimd::log(alpha2) * spread);
  }
  // pdf_solid_angle = distribution cos_theta.
  Vec3 sample_normal(Vec2 u) const {
    const Float power = xsimd::exp((Float(1.F) - u.y) * xsimd::log(alpha2));
    const Float rest = Float(1.F) / (Float(1.F) - alpha2);
    const Float sine = safe_sqrt((power - alpha2) * rest);
    const SinCos turn = sincos_turn(u.x);
    return {sine * turn.cos, sine * turn.sin, safe_sqrt((Float(1.F) - power) * rest)};
  }
};

}  // namespace metrofarm::bsdf
