#include "bsdf/lobes_diffuse.h"

namespace metrofarm::bsdf {

Row DiffuseLobe::row(const scene::Diffuse& d) {
  Row row;
  row.put(kReflectance, d.reflectance);
  return row;
}

Evaluation DiffuseLobe::evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                                 Transport /*transport*/) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  const Float pdf = keep(lit, wi.z * Float(kInvPi));
  return {p.rgb(kReflectance) * pdf, pdf};
}

Sample DiffuseLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                           Transport /*transport*/) {
  Sample s;
  s.wi = square_to_cosine_hemisphere(u.direction);
  s.pdf_solid_angle = s.wi.z * Float(kInvPi);
  s.weight = p.rgb(kReflectance);
  s.valid = lanes & (wo.z > Float(0.F)) & (s.pdf_solid_angle > Float(0.F));
  return s;
}

Row DiffuseTransmitterLobe::row(const scene::DiffuseTransmitter& d) {
  Row row;
  row.put(kTransmittance, d.transmittance);
  return row;
}

Evaluation DiffuseTransmitterLobe::evaluate(const Parameters& p, Mask lanes, const Vec3& wo,
                                            const Vec3& wi, Transport /*transport*/) {
  const Mask lit = lanes & (wo.z * wi.z < Float(0.F));
  const Float pdf = keep(lit, xsimd::abs(wi.z) * Float(kInvPi));
  return {p.rgb(kTransmittance) * pdf, pdf};
}

Sample DiffuseTransmitterLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                                      const SampleInput& u, Transport /*transport*/) {
  Sample s;
  s.wi = square_to_cosine_hemisphere(u.direction);
  s.pdf_solid_angle = s.wi.z * Float(kInvPi);
  s.valid = lanes & (wo.z != Float(0.F)) & (s.pdf_solid_angle > Float(0.F));
  s.wi.z = xsimd::copysign(s.wi.z, -wo.z);
  s.weight = p.rgb(kTransmittance);
  return s;
}

Sample NullLobe::sample(const Parameters& /*p*/, Mask lanes, const Vec3& wo,
                        const SampleInput& /*u*/, Transport /*transport*/) {
  Sample s;
  s.wi = -wo;
  s.weight = splat(1.F);
  s.valid = lanes;
  s.delta = lanes;
  return s;
}

}  // namespace metrofarm::bsdf
