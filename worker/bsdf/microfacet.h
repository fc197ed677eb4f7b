// Microfacet normal distributions, anisotropic, around +z, with Smith's masking; visible normals
// are sampled.
//
// GGX: Walter et al. 2007; its visible normals by Dupuy and Benyoub 2023, "Sampling Visible GGX
// Normals with Spherical Caps", listing 3. Beckmann: Walter et al. 2007 with the rational
// approximation of Smith's function (eq. 27); its visible normals by Jakob 2014, "An Improved
// Visible Normal Sampling Routine for the Beckmann Distribution".
#pragma once

#include "bsdf/error_function.h"
#include "math/warp.h"

namespace metrofarm::bsdf {

struct Roughness {
  Float alpha_u, alpha_v;
};

// Smoother surfaces than this count as this rough: floats hold no narrower lobe.
inline constexpr float kSmallestRoughness = 1e-4F;

inline Roughness roughness(Float alpha_u, Float alpha_v) {
  const Float smallest(kSmallestRoughness);
  return {xsimd::max(alpha_u, smallest), xsimd::max(alpha_v, smallest)};
}

struct Ggx {
  // Density of normals; integrates cos_theta D to 1.
  static Float distribution(const Vec3& m, const Roughness& a) {
    const Float e = sqr(m.x / a.alpha_u) + sqr(m.y / a.alpha_v) + sqr(m.z);
    return Float(1.F) / (Float(kPi) * a.alpha_u * a.alpha_v * sqr(e));
  }

  // Smith's masking of direction v, of either side. Requires: v.z is not 0.
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
};

struct Beckmann {
  static Float distribution(const Vec3& m, const Roughness& a) {
    const Float cos2 = sqr(m.z);
    const Float exponent = (sqr(m.x / a.alpha_u) + sqr(m.y / a.alpha_v)) / cos2;
    const Float d = xsimd::exp(-exponent) / (Float(kPi) * a.alpha_u * a.alpha_v * sqr(cos2));
    // Beyond this exponent floats have nothing left, and 1 / cos^4 may be infinite.
    return keep((m.z > Float(0.F)) & (exponent < Float(80.F)), d);
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

  // A normal visible from wo. Requires: wo.z > 0.
  static Vec3 sample_normal(const Vec3& wo, Vec2 u, const Roughness& a) {
    const Vec3 stretched{wo.x * a.alpha_u, wo.y * a.alpha_v, wo.z};
    const Float across = xsimd::sqrt(sqr(stretched.x) + sqr(stretched.y));
    const Mask upright = across <= Float(1e-6F) * wo.z;
    const Float cos_phi = select(upright, Float(1.F), stretched.x / across);
    const Float sin_phi = keep(~upright, stretched.y / across);
    // Slope in the plane of wo, then across it; both for unit roughness.
    const Float p = visible_slope(xsimd::max(across / wo.z, Float(1e-6F)), inner(u.x));
    const Float q = erf_inverse(Float(2.F) * inner(u.y) - Float(1.F));
    const Float slope_x = (cos_phi * p - sin_phi * q) * a.alpha_u;
    const Float slope_y = (sin_phi * p + cos_phi * q) * a.alpha_v;
    return normalize(Vec3{-slope_x, -slope_y, Float(1.F)});
  }

 private:
  // The borders of the unit interval belong to infinite slopes.
  static Float inner(Float u) {
    return xsimd::min(xsimd::max(u, Float(1e-6F)), Float(1.F - 1e-6F));
  }

  // Inverts the distribution of slopes visible at an angle of this tangent, which is smooth in
  // x = erf(slope): proportional to 1 + x + tan exp(-slope^2) / sqrt(pi) (Jakob 2014, eq. 2), by
  // Newton's method from the solution at grazing incidence.
  static Float visible_slope(Float tangent, Float u) {
    const Float cotangent = Float(1.F) / tangent;
    const Float scaled = tangent * Float(0.56418958F);
    const Float highest = xsimd::erf(cotangent);
    const Float total = Float(1.F) + highest + scaled * xsimd::exp(-sqr(cotangent));
    const Float target = u * total;
    const Float bound(1.F - 6e-7F);
    Float x = highest - (highest + Float(1.F)) * xsimd::erf(safe_sqrt(-xsimd::log(u)));
    for (int step = 0; step < 4; ++step) {
      x = xsimd::min(xsimd::max(x, -bound), bound);
      const Float slope = erf_inverse(x);
      const Float value = Float(1.F) + x + scaled * xsimd::exp(-sqr(slope)) - target;
      const Float derivative = Float(1.F) - slope * tangent;
      x = x - value / derivative;
    }
    return erf_inverse(xsimd::min(xsimd::max(x, -bound), bound));
  }
};

// pdf_solid_angle of Distribution::sample_normal, over normals. Requires: wo.z > 0.
template <class Distribution>
Float pdf_visible_normal(const Vec3& wo, const Vec3& m, const Roughness& a) {
  return Distribution::masking(wo, a) * xsimd::max(dot(wo, m), Float(0.F)) *
         Distribution::distribution(m, a) / wo.z;
}

}  // namespace metrofarm::bsdf
