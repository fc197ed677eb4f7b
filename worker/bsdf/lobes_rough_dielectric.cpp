#include "bsdf/fresnel.h"
#include "bsdf/half_vector.h"
#include "bsdf/lobes_dielectric.h"
#include "bsdf/microfacet.h"

namespace metrofarm::bsdf {

template <class Distribution>
Row RoughDielectricLobe<Distribution>::row(const scene::RoughDielectric& d) {
  Row row;
  row.put(kEta, d.eta);
  row.put(kReflectance, d.specular_reflectance);
  row.put(kTransmittance, d.specular_transmittance);
  row.put(kAlphaU, d.alpha_u);
  row.put(kAlphaV, d.alpha_v);
  return row;
}

template <class Distribution>
Evaluation RoughDielectricLobe<Distribution>::evaluate(const Parameters& p, Mask lanes,
                                                       const Vec3& wo, const Vec3& wi,
                                                       Transport transport) {
  const Roughness alpha = roughness(p.number(kAlphaU), p.number(kAlphaV));
  const InterfaceCrossing x(wo, wi, p.number(kEta));
  const Float density = Distribution::distribution(x.m, alpha);
  const Float fresnel = fresnel_dielectric(x.cos_o, x.eta).reflectance;
  const Float visible =
      density * Distribution::masking(wo, alpha) * x.cos_o * x.jacobian() / xsimd::abs(wo.z);
  const Float pdf = visible * select(x.reflect, fresnel, Float(1.F) - fresnel);
  const Float scale = transport == Transport::kRadiance ? Float(1.F) / sqr(x.eta) : Float(1.F);
  const Spectrum tint = select(x.reflect, p.rgb(kReflectance), p.rgb(kTransmittance) * scale);
  const Mask defined = lanes & x.compatible & (pdf > Float(0.F));
  return {keep(defined, tint * (pdf * Distribution::masking(wi, alpha))), keep(defined, pdf)};
}

// Works from the sampled normal, like the rough conductor.
template <class Distribution>
Sample RoughDielectricLobe<Distribution>::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                                                 const SampleInput& u, Transport transport) {
  const Roughness alpha = roughness(p.number(kAlphaU), p.number(kAlphaV));
  const Mask entering = wo.z > Float(0.F);
  const Float side = select(entering, Float(1.F), Float(-1.F));
  const Float eta = select(entering, p.number(kEta), Float(1.F) / p.number(kEta));
  // In a frame whose +z is on the side of wo.
  const Vec3 o{wo.x, wo.y, wo.z * side};
  const Vec3 m = Distribution::sample_normal(o, u.direction, alpha);
  const Float cos_o = dot(o, m);
  const DielectricInterface boundary = fresnel_dielectric(cos_o, eta);
  const Mask reflect = u.lobe < boundary.reflectance;
  const Float cos_t = boundary.cos_transmitted;
  const Vec3 refracted = m * (cos_o / eta - cos_t) - o * (Float(1.F) / eta);
  const Vec3 i = select(reflect, m * (Float(2.F) * cos_o) - o, refracted);

  Sample s;
  const Float visible =
      Distribution::distribution(m, alpha) * Distribution::masking(o, alpha) * cos_o / o.z;
  const Float jacobian =
      select(reflect, Float(0.25F) / cos_o, sqr(eta) * cos_t / sqr(cos_o - eta * cos_t));
  s.pdf_solid_angle =
      visible * jacobian * select(reflect, boundary.reflectance, Float(1.F) - boundary.reflectance);
  const Float scale = transport == Transport::kRadiance ? Float(1.F) / sqr(eta) : Float(1.F);
  const Spectrum tint = select(reflect, p.rgb(kReflectance), p.rgb(kTransmittance) * scale);
  const Mask right_side = select(reflect, i.z, -i.z) > Float(0.F);
  s.valid = lanes & right_side & (cos_o > Float(0.F)) & (s.pdf_solid_angle > Float(0.F));
  s.wi = {i.x, i.y, i.z * side};
  s.weight = keep(s.valid, tint * Distribution::masking(i, alpha));
  s.eta = select(reflect, Float(1.F), eta);
  return s;
}

template struct RoughDielectricLobe<Ggx>;
template struct RoughDielectricLobe<Beckmann>;

}  // namespace metrofarm::bsdf
