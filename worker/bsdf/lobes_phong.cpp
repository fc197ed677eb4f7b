#include "bsdf/lobes_phong.h"

namespace metrofarm::bsdf {
namespace {

Float specular_probability(const Parameters& p) {
  const Spectrum s = p.rgb(PhongLobe::kSpecular), d = p.rgb(PhongLobe::kDiffuse);
  const Float specular = s.x + s.y + s.z, sum = specular + d.x + d.y + d.z;
  return select(sum > Float(0.F), specular / sum, Float(0.5F));
}

}  // namespace

Row PhongLobe::row(const scene::Phong& d) {
  Row row;
  row.put(kDiffuse, d.diffuse_reflectance);
  row.put(kSpecular, d.specular_reflectance);
  row.put(kExponent, d.exponent);
  return row;
}

Evaluation PhongLobe::evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                               Transport /*transport*/) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  if (none(lit)) return {};
  const Float exponent = p.number(kExponent);
  const Float cos_alpha = wo.z * wi.z - wo.x * wi.x - wo.y * wi.y;  // to the mirror direction
  const Float power = keep(cos_alpha > Float(0.F), xsimd::pow(cos_alpha, exponent));
  const Float turn(0.5F * kInvPi);
  const Float peak = (exponent + Float(2.F)) * turn * power;
  const Float diffuse_pdf = wi.z * Float(kInvPi);
  const Float probability = specular_probability(p);
  const Float pdf = probability * (exponent + Float(1.F)) * turn * power +
                    (Float(1.F) - probability) * diffuse_pdf;
  const Spectrum value = p.rgb(kSpecular) * (peak * wi.z) + p.rgb(kDiffuse) * diffuse_pdf;
  return {keep(lit, value), keep(lit, pdf)};
}

Sample PhongLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                         Transport transport) {
  const Mask specular = u.lobe < specular_probability(p);
  const Float inverse = Float(1.F) / (p.number(kExponent) + Float(1.F));
  // 1 - u.x > 0, so that the logarithm exists; sin^2 = 1 - cos^2 for narrow lobes.
  const Float log_cos = xsimd::log(Float(1.F) - u.direction.x) * inverse;
  const Float cos_alpha = xsimd::exp(log_cos);
  const Float sin_alpha = safe_sqrt(-xsimd::expm1(Float(2.F) * log_cos));
  const SinCos turn = sincos_turn(u.direction.y);
  const Frame mirror = frame_around({-wo.x, -wo.y, wo.z});
  const Vec3 around = mirror.to_world({sin_alpha * turn.cos, sin_alpha * turn.sin, cos_alpha});
  Sample s;
  s.wi = select(specular, around, square_to_cosine_hemisphere(u.direction));
  const Evaluation e = evaluate(p, lanes, wo, s.wi, transport);
  s.pdf_solid_angle = e.pdf_solid_angle;
  s.valid = lanes & (s.pdf_solid_angle > Float(0.F));
  s.weight = keep(s.valid, e.value / s.pdf_solid_angle);
  return s;
}

}  // namespace metrofarm::bsdf
