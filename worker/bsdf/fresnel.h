// Fresnel reflectance of smooth interfaces for unpolarized light.
#pragma once

#include "math/vec.h"

namespace metrofarm::bsdf {

// Conductor of index eta + i k (relative to the outside); cosine of incidence in [0, 1].
// Born and Wolf 1999, section 14.4, in the form without complex arithmetic.
inline Float fresnel_conductor(Float cos_theta, Float eta, Float k) {
  const Float cos2 = cos_theta * cos_theta;
  const Float sin2 = Float(1.F) - cos2;
  const Float sin4 = sin2 * sin2;
  const Float base = eta * eta - k * k - sin2;
  const Float a2_plus_b2 = xsimd::sqrt(base * base + Float(4.F) * eta * eta * k * k);
  const Float a = safe_sqrt(Float(0.5F) * (a2_plus_b2 + base));
  const Float sum_s = a2_plus_b2 + cos2;
  const Float cross_s = Float(2.F) * a * cos_theta;
  const Float r_s = (sum_s - cross_s) / (sum_s + cross_s);
  const Float sum_p = a2_plus_b2 * cos2 + sin4;
  const Float cross_p = cross_s * sin2;
  const Float r_p = r_s * (sum_p - cross_p) / (sum_p + cross_p);
  return Float(0.5F) * (r_s + r_p);
}

inline Vec3 fresnel_conductor(Float cos_theta, const Vec3& eta, const Vec3& k) {
  return {fresnel_conductor(cos_theta, eta.x, k.x), fresnel_conductor(cos_theta, eta.y, k.y),
          fresnel_conductor(cos_theta, eta.z, k.z)};
}

struct DielectricInterface {
  Float reflectance;      // 1 under total internal reflection
  Float cos_transmitted;  // cosine of the refracted ray, 0 under total internal reflection
};

// eta: index on the far side over index on the side of incidence; cosine of incidence in [0, 1].
inline DielectricInterface fresnel_dielectric(Float cos_theta, Float eta) {
  const Float sin2_t = (Float(1.F) - cos_theta * cos_theta) / (eta * eta);
  const Float cos_t = safe_sqrt(Float(1.F) - sin2_t);
  const Float r_s = (cos_theta - eta * cos_t) / (cos_theta + eta * cos_t);
  const Float r_p = (eta * cos_theta - cos_t) / (eta * cos_theta + cos_t);
  const Float partial = Float(0.5F) * (r_s * r_s + r_p * r_p);
  return {select(sin2_t < Float(1.F), partial, Float(1.F)), cos_t};
}

// Reflectance of a smooth boundary for diffuse light, eta as above: the fits of Egan and Hilgeman
// 1973 (eta < 1) and d'Eon and Irving 2011 (eta >= 1), which are Mitsuba's.
inline double diffuse_fresnel_reflectance(double eta) {
  const double i = 1 / eta;
  if (eta < 1) return -1.4399 * eta * eta + 0.7099 * eta + 0.6681 + 0.0636 * i;
  return 0.919317 + i * (-3.4793 + i * (6.75335 + i * (-7.80989 + i * (4.98554 - 1.36881 * i))));
}

}  // namespace metrofarm::bsdf
