#include "bsdf/fresnel.h"
#include "bsdf/lobes_principled.h"
#include "bsdf/principled_terms.h"

namespace metrofarm::bsdf {
namespace {

using P = PrincipledThinLobe;

struct Mixture {
  explicit Mixture(const Parameters& p) {
    const Float specular = p.number(P::kSpecTrans);
    through = p.number(P::kDiffTrans) * Float(0.5F);
    const Float half = specular * Float(0.5F), rest = Float(1.F) - specular;
    spec_reflect = half * p.number(P::kSpecReflectRate);
    spec_transmit = half * p.number(P::kSpecTransmitRate);
    diffuse_reflect = rest * (Float(1.F) - through) * p.number(P::kDiffuseReflectRate);
    diffuse_transmit = rest * through * p.number(P::kDiffuseTransmitRate);
    const Float sum = spec_reflect + spec_transmit + diffuse_reflect + diffuse_transmit;
    // Rates and weights may leave nothing to choose from: then nothing is sampled.
    const Float inverse = keep(sum > Float(0.F), Float(1.F) / sum);
    spec_reflect = spec_reflect * inverse;
    spec_transmit = spec_transmit * inverse;
    diffuse_reflect = diffuse_reflect * inverse;
    diffuse_transmit = diffuse_transmit * inverse;
  }

  Float through;  // share of the diffuse light that passes
  Float spec_reflect, spec_transmit, diffuse_reflect, diffuse_transmit;  // probabilities
};

// Transmission bends twice and blurs by the index (Burley 2015, section 4.3).
Roughness transmission_roughness(const Parameters& p) {
  const Float scaled = (Float(0.65F) * p.number(P::kEta) - Float(0.35F)) * p.number(P::kRoughness);
  return principled_roughness(scaled, p.number(P::kAnisotropic));
}

// Specular part and its density of directions. o, i: mirrored to the side of wo.
Evaluation specular_part(const Parameters& p, const Mixture& mixture, Mask reflect, const Vec3& o,
                         const Vec3& i, const Vec3& m) {
  const Float eta = p.number(P::kEta), cos_o = dot(o, m);
  const Float exact = fresnel_dielectric(cos_o, eta).reflectance;
  const Roughness near = principled_roughness(p.number(P::kRoughness), p.number(P::kAnisotropic));
  const Roughness far = transmission_roughness(p);
  const Roughness alpha{select(reflect, near.alpha_u, far.alpha_u),
                        select(reflect, near.alpha_v, far.alpha_v)};
  const Float visible = Ggx::distribution(m, alpha) * Ggx::masking(o, alpha) / (Float(4.F) * o.z);
  const Spectrum base = p.rgb(P::kBase);
  const Spectrum coloured =
      schlick(tint_of(base) * normal_reflectance(eta), schlick_weight(cos_o, eta));
  const Spectrum mirrored = mix(splat(1.F) * exact, coloured, p.number(P::kSpecTint));
  const Spectrum tint = select(reflect, mirrored, base * (Float(1.F) - exact));
  const Float probability = select(reflect, mixture.spec_reflect, mixture.spec_transmit);
  return {tint * (p.number(P::kSpecTrans) * visible * Ggx::masking(i, alpha)),
          probability * visible};
}

// Diffuse part without its density. Requires: o.z and i.z > 0.
Spectrum diffuse_part(const Parameters& p, Float through, Mask reflect, const Vec3& o,
                      const Vec3& i, Float cos_d) {
  const Spectrum base = p.rgb(P::kBase);
  const DiffuseTerms terms(o.z, i.z, cos_d, p.number(P::kRoughness), p.number(P::kFlatness));
  const Spectrum colour = mix(splat(1.F), tint_of(base), p.number(P::kSheenTint));
  const Spectrum above = base * terms.diffuse + colour * (p.number(P::kSheen) * terms.sheen);
  const Float rest = (Float(1.F) - p.number(P::kSpecTrans)) * i.z;
  return select(reflect, above * (rest * (Float(1.F) - through)),
                base * (rest * through * Float(kInvPi)));
}

// The half vector of passing light must face the direction itself from below (Mitsuba's rule).
Mask faces_below(const Vec3& mirrored, const Vec3& m) {
  return mirrored.z * m.z > mirrored.x * m.x + mirrored.y * m.y;
}

}  // namespace

Row PrincipledThinLobe::row(const scene::PrincipledThin& d) {
  Row row;
  row.put(kBase, d.base_color);
  row.put(kRoughness, d.roughness);
  row.put(kAnisotropic, d.anisotropic);
  row.put(kSpecTrans, d.spec_trans);
  row.put(kDiffTrans, d.diff_trans);
  row.put(kSpecTint, d.spec_tint);
  row.put(kSheen, d.sheen);
  row.put(kSheenTint, d.sheen_tint);
  row.put(kFlatness, d.flatness);
  row.put(kEta, d.eta);
  row.put(kSpecReflectRate, d.spec_reflectance_sampling_rate);
  row.put(kSpecTransmitRate, d.spec_transmittance_sampling_rate);
  row.put(kDiffuseReflectRate, d.diffuse_reflectance_sampling_rate);
  row.put(kDiffuseTransmitRate, d.diffuse_transmittance_sampling_rate);
  return row;
}

Evaluation PrincipledThinLobe::evaluate(const Parameters& p, Mask lanes, const Vec3& wo,
                                        const Vec3& wi, Transport /*transport*/) {
  const Mixture mixture(p);
  const Mask active = lanes & (wo.z * wi.z != Float(0.F));
  const Mask reflect = wo.z * wi.z > Float(0.F);
  const Vec3 o{wo.x, wo.y, xsimd::abs(wo.z)}, i{wi.x, wi.y, xsimd::abs(wi.z)};
  const Vec3 m = normalize(o + i);
  const Float cos_i = dot(i, m);
  const Mask specular =
      active & (p.number(kSpecTrans) > Float(0.F)) & (reflect | faces_below(i, m));
  Evaluation e;
  if (any(specular)) {
    const Evaluation part = specular_part(p, mixture, reflect, o, i, m);
    e = {keep(specular, part.value), keep(specular, part.pdf_solid_angle)};
  }
  const Float probability = select(reflect, mixture.diffuse_reflect, mixture.diffuse_transmit);
  e.value = e.value + keep(active, diffuse_part(p, mixture.through, reflect, o, i, cos_i));
  e.pdf_solid_angle = e.pdf_solid_angle + keep(active, probability * i.z * Float(kInvPi));
  return e;
}

Sample PrincipledThinLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo,
                                  const SampleInput& u, Transport transport) {
  const Mixture mixture(p);
  const Float specular_end = mixture.spec_reflect + mixture.spec_transmit;
  const Mask specular = u.lobe < specular_end;
  const Mask reflect = select(specular, u.lobe, u.lobe - specular_end) <
                       select(specular, mixture.spec_reflect, mixture.diffuse_reflect);
  const Vec3 o{wo.x, wo.y, xsimd::abs(wo.z)};
  Vec3 i = square_to_cosine_hemisphere(u.direction);
  Mask possible = lanes;
  if (any(lanes & specular)) {
    const Roughness near = principled_roughness(p.number(kRoughness), p.number(kAnisotropic));
    const Roughness far = transmission_roughness(p);
    const Roughness alpha{select(reflect, near.alpha_u, far.alpha_u),
                          select(reflect, near.alpha_v, far.alpha_v)};
    const Vec3 m = Ggx::sample_normal(o, u.direction, alpha);
    i = select(specular, m * (Float(2.F) * dot(o, m)) - o, i);
    possible = possible & (~specular | reflect | faces_below(i, m));
  }
  Sample s;
  const Float side = xsimd::copysign(Float(1.F), wo.z);
  s.wi = {i.x, i.y, i.z * select(reflect, side, -side)};
  const Mask above = possible & (i.z > Float(0.F));
  const Evaluation e = evaluate(p, above, wo, s.wi, transport);
  s.pdf_solid_angle = e.pdf_solid_angle;
  s.valid = above & (s.pdf_solid_angle > Float(0.F));
  s.weight = keep(s.valid, e.value / s.pdf_solid_angle);
  return s;
}

}  // namespace metrofarm::bsdf
