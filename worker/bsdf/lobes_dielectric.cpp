#include "bsdf/lobes_dielectric.h"

#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"

namespace metrofarm::bsdf {

Row DielectricLobe::row(const scene::Dielectric& d) {
  Row row;
  row.put(kEta, d.eta);
  row.put(kReflectance, d.specular_reflectance);
  row.put(kTransmittance, d.specular_transmittance);
  return row;
}

Sample DielectricLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                              Transport transport) {
  const Float interior = p.number(kEta);
  const Mask entering = wo.z > Float(0.F);
  const Float eta = select(entering, interior, Float(1.F) / interior);
  const Float cos_o = xsimd::abs(wo.z);
  const DielectricInterface boundary = fresnel_dielectric(cos_o, eta);
  const Mask reflect = u.lobe < boundary.reflectance;
  const Float inverse_eta = Float(1.F) / eta;
  const Float cos_t = select(entering, -boundary.cos_transmitted, boundary.cos_transmitted);
  const Vec3 refracted{-wo.x * inverse_eta, -wo.y * inverse_eta, cos_t};
  const Float scale = transport == Transport::kRadiance ? sqr(inverse_eta) : Float(1.F);
  Sample s;
  s.wi = select(reflect, Vec3{-wo.x, -wo.y, wo.z}, refracted);
  s.weight = select(reflect, p.rgb(kReflectance), p.rgb(kTransmittance) * scale);
  s.eta = select(reflect, Float(1.F), eta);
  s.valid = lanes & (cos_o > Float(0.F));
  s.delta = s.valid;
  return s;
}

Row ThinDielectricLobe::row(const scene::ThinDielectric& d) {
  Row row;
  row.put(kEta, d.eta);
  row.put(kReflectance, d.specular_reflectance);
  row.put(kTransmittance, d.specular_transmittance);
  return row;
}

Sample ThinDielectricLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                                  const SampleInput& u, Transport /*transport*/) {
  const Float cos_o = xsimd::abs(wo.z);
  const Float once = fresnel_dielectric(cos_o, p.number(kEta)).reflectance;
  // r + t r t + t r^3 t + ... for the two faces together.
  const Float reflectance = Float(2.F) * once / (Float(1.F) + once);
  const Mask reflect = u.lobe < reflectance;
  Sample s;
  s.wi = select(reflect, Vec3{-wo.x, -wo.y, wo.z}, -wo);
  s.weight = select(reflect, p.rgb(kReflectance), p.rgb(kTransmittance));
  s.valid = lanes & (cos_o > Float(0.F));
  s.delta = s.valid;
  return s;
}

}  // namespace metrofarm::bsdf
