#include "bsdf/lobes_conductor.h"

#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"

namespace metrofarm::bsdf {

Row ConductorLobe::row(const scene::Conductor& c) {
  Row row;
  row.put(kEta, c.eta);
  row.put(kK, c.k);
  row.put(kReflectance, c.specular_reflectance);
  return row;
}

Sample ConductorLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                             const SampleInput& /*u*/, Transport /*transport*/) {
  Sample s;
  s.wi = {-wo.x, -wo.y, wo.z};
  s.valid = lanes & (wo.z > Float(0.F));
  s.delta = s.valid;
  s.weight = fresnel_conductor(wo.z, p.rgb(kEta), p.rgb(kK)) * p.rgb(kReflectance);
  return s;
}

template <class Distribution>
Row RoughConductorLobe<Distribution>::row(const scene::RoughConductor& c) {
  Row row;
  row.put(kEta, c.eta);
  row.put(kK, c.k);
  row.put(kReflectance, c.specular_reflectance);
  row.put(kAlphaU, c.alpha_u);
  row.put(kAlphaV, c.alpha_v);
  return row;
}

template <class Distribution>
Evaluation RoughConductorLobe<Distribution>::evaluate(const Parameters& p, Mask lanes,
                                                      const Vec3& wo, const Vec3& wi,
                                                      Transport /*transport*/) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  if (none(lit)) return {};
  const Roughness alpha = roughness(p.number(kAlphaU), p.number(kAlphaV));
  const Vec3 m = normalize(wo + wi);
  const Float density = Distribution::distribution(m, alpha);
  // Reflection has the Jacobian 1 / (4 wo . m), which cancels the projection of visible normals.
  const Float pdf = density * Distribution::masking(wo, alpha) / (Float(4.F) * wo.z);
  const Spectrum fresnel = fresnel_conductor(dot(wo, m), p.rgb(kEta), p.rgb(kK));
  const Spectrum value = fresnel * p.rgb(kReflectance) * (pdf * Distribution::masking(wi, alpha));
  const Mask defined = lit & (density > Float(0.F));
  return {keep(defined, value), keep(defined, pdf)};
}

// Works from the sampled normal: computing it back from wi would lose the digits of narrow lobes.
template <class Distribution>
Sample RoughConductorLobe<Distribution>::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                                                const SampleInput& u, Transport /*transport*/) {
  Sample s;
  const Roughness alpha = roughness(p.number(kAlphaU), p.number(kAlphaV));
  const Vec3 m = Distribution::sample_normal(wo, u.direction, alpha);
  const Float cos_m = dot(wo, m);
  s.wi = m * (Float(2.F) * cos_m) - wo;
  s.pdf_solid_angle =
      Distribution::distribution(m, alpha) * Distribution::masking(wo, alpha) / (Float(4.F) * wo.z);
  s.valid = lanes & (wo.z > Float(0.F)) & (s.wi.z > Float(0.F)) & (cos_m > Float(0.F)) &
            (s.pdf_solid_angle > Float(0.F));
  const Spectrum fresnel = fresnel_conductor(cos_m, p.rgb(kEta), p.rgb(kK));
  s.weight = keep(s.valid, fresnel * p.rgb(kReflectance) * Distribution::masking(s.wi, alpha));
  return s;
}

template struct RoughConductorLobe<Ggx>;
template struct RoughConductorLobe<Beckmann>;

}  // namespace metrofarm::bsdf
