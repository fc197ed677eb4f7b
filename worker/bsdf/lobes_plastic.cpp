#include "bsdf/lobes_plastic.h"

#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"

namespace metrofarm::bsdf {
namespace {

// Both plastics keep these in the same columns.
using Base = PlasticLobe;

Float mean(const Spectrum& s) {
  return (s.x + s.y + s.z) * Float(1.F / 3.F);
}

// Probability of choosing the mirror part, when the coating reflects this share of the light.
Float specular_probability(const Parameters& p, Float reflected) {
  const Float specular = reflected * mean(p.rgb(Base::kSpecular));
  const Float diffuse = (Float(1.F) - reflected) * mean(p.rgb(Base::kDiffuse));
  const Float sum = specular + diffuse;
  return select(sum > Float(0.F), specular / sum, Float(0.5F));
}

// What the base sends back of the light below the coating, all inner reflections added up, as it
// is seen outside.
Spectrum base_colour(const Parameters& p) {
  const Spectrum diffuse = p.rgb(Base::kDiffuse);
  const Float nonlinear = p.number(Base::kNonlinear), internal = p.number(Base::kInternal);
  const auto channel = [&](Float d) {
    const Float coloured = Float(1.F) + nonlinear * (d - Float(1.F));
    return d / (Float(1.F) - internal * coloured);
  };
  return Spectrum{channel(diffuse.x), channel(diffuse.y), channel(diffuse.z)} *
         (Float(1.F) / sqr(p.number(Base::kEta)));
}

}  // namespace

Row PlasticLobe::row(const scene::Plastic& d) {
  Row row;
  row.put(kDiffuse, d.diffuse_reflectance);
  row.put(kSpecular, d.specular_reflectance);
  row.put(kEta, d.eta);
  row.put(kInternal, static_cast<float>(diffuse_fresnel_reflectance(1.0 / d.eta)));
  row.put(kNonlinear, d.nonlinear ? 1.F : 0.F);
  return row;
}

Evaluation PlasticLobe::evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                                 Transport /*transport*/) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  if (none(lit)) return {};
  const Float eta = p.number(kEta);
  const Float f_o = fresnel_dielectric(wo.z, eta).reflectance;
  const Float f_i = fresnel_dielectric(wi.z, eta).reflectance;
  const Float cosine = wi.z * Float(kInvPi);
  const Float pdf = (Float(1.F) - specular_probability(p, f_o)) * cosine;
  const Float through = (Float(1.F) - f_o) * (Float(1.F) - f_i);
  return {keep(lit, base_colour(p) * (cosine * through)), keep(lit, pdf)};
}

Sample PlasticLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                           Transport /*transport*/) {
  const Float eta = p.number(kEta);
  const Float f_o = fresnel_dielectric(wo.z, eta).reflectance;
  const Float probability = specular_probability(p, f_o);
  const Vec3 scattered = square_to_cosine_hemisphere(u.direction);
  const Float f_i = fresnel_dielectric(scattered.z, eta).reflectance;
  const Float rest = Float(1.F) - probability;
  const Float through = (Float(1.F) - f_o) * (Float(1.F) - f_i);
  Sample s;
  s.delta = u.lobe < probability;
  s.wi = select(s.delta, Vec3{-wo.x, -wo.y, wo.z}, scattered);
  s.pdf_solid_angle = rest * scattered.z * Float(kInvPi);
  s.valid = lanes & (wo.z > Float(0.F)) & (s.delta | (s.pdf_solid_angle > Float(0.F)));
  s.delta = s.delta & s.valid;
  s.weight = keep(s.valid, select(s.delta, p.rgb(kSpecular) * (f_o / probability),
                                  base_colour(p) * (through / rest)));
  return s;
}

template <class Distribution>
Row RoughPlasticLobe<Distribution>::row(const scene::RoughPlastic& d, TransmittanceTables& tables) {
  const auto coating = tables.add(d.distribution, d.alpha, d.eta);
  Row row;
  row.put(kDiffuse, d.diffuse_reflectance);
  row.put(kSpecular, d.specular_reflectance);
  row.put(kEta, d.eta);
  row.put(kInternal, coating.internal_reflectance);
  row.put(kNonlinear, d.nonlinear ? 1.F : 0.F);
  row.put(kAlpha, d.alpha);
  row.put(kTable, static_cast<float>(coating.table));
  return row;
}

template <class Distribution>
Evaluation RoughPlasticLobe<Distribution>::evaluate(const Parameters& p, Mask lanes, const Vec3& wo,
                                                    const Vec3& wi, Transport /*transport*/) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  if (none(lit)) return {};
  const Int table = truncate(p.number(kTable));
  const Float t_o = TransmittanceTables::look_up(p.transmittance, table, wo.z, lit);
  const Float t_i = TransmittanceTables::look_up(p.transmittance, table, wi.z, lit);
  const Roughness alpha = roughness(p.number(kAlpha), p.number(kAlpha));
  const Vec3 m = normalize(wo + wi);
  const Float visible =
      Distribution::distribution(m, alpha) * Distribution::masking(wo, alpha) / (Float(4.F) * wo.z);
  const Float fresnel = fresnel_dielectric(dot(wo, m), p.number(kEta)).reflectance;
  const Float mirrored = fresnel * visible * Distribution::masking(wi, alpha);
  const Float cosine = wi.z * Float(kInvPi);
  const Float probability = specular_probability(p, Float(1.F) - t_o);
  const Float pdf = probability * visible + (Float(1.F) - probability) * cosine;
  const Spectrum value = p.rgb(kSpecular) * mirrored + base_colour(p) * (cosine * t_o * t_i);
  return {keep(lit, value), keep(lit, pdf)};
}

template <class Distribution>
Sample RoughPlasticLobe<Distribution>::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                                              const SampleInput& u, Transport transport) {
  const Mask front = lanes & (wo.z > Float(0.F));
  const Int table = truncate(p.number(kTable));
  const Float t_o = TransmittanceTables::look_up(p.transmittance, table, wo.z, front);
  const Mask specular = u.lobe < specular_probability(p, Float(1.F) - t_o);
  const Roughness alpha = roughness(p.number(kAlpha), p.number(kAlpha));
  Sample s;
  s.wi = square_to_cosine_hemisphere(u.direction);
  if (any(front & specular)) {
    const Vec3 m = Distribution::sample_normal(wo, u.direction, alpha);
    s.wi = select(specular, m * (Float(2.F) * dot(wo, m)) - wo, s.wi);
  }
  const Evaluation e = evaluate(p, front, wo, s.wi, transport);
  s.pdf_solid_angle = e.pdf_solid_angle;
  s.valid = front & (s.pdf_solid_angle > Float(0.F));
  s.weight = keep(s.valid, e.value / s.pdf_solid_angle);
  return s;
}

template struct RoughPlasticLobe<Ggx>;
template struct RoughPlasticLobe<Beckmann>;

}  // namespace metrofarm::bsdf
