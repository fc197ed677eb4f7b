#include "bsdf/lobes_principled.h"
#include "bsdf/fresnel.h"
#include "bsdf/half_vector.h"
#include "bsdf/principled_terms.h"

namespace metrofarm::bsdf {
namespace {

using P = PrincipledLobe;

// Weights of the two major lobes, and probabilities of sampling each part. Behind the surface only
// the specular part exists.
struct Mixture {
  Mixture(const Parameters& p, Mask front) {
    const Float dielectric = Float(1.F) - p.number(P::kMetallic);
    reflecting = dielectric * (Float(1.F) - p.number(P::kSpecTrans));
    refracting = dielectric * p.number(P::kSpecTrans);
    const Float specular_share = p.number(P::kSpecularRate);
    const Float coat_share = Float(0.25F) * p.number(P::kClearcoat) * p.number(P::kClearcoatRate);
    const Float diffuse_share = reflecting * p.number(P::kDiffuseRate);
    const Float sum = specular_share + coat_share + diffuse_share;
    // Rates and weights may leave nothing to choose from: the specular part then stands for all.
    const Mask choice = front & (sum > Float(0.F));
    specular = select(choice, specular_share / sum, Float(1.F));
    clearcoat = keep(choice, coat_share / sum);
    diffuse = keep(choice, diffuse_share / sum);
  }

  // Share of the specular part that crosses a facet of this reflectance.
  Float crossing(Mask front, Float fresnel) const {
    return select(front, refracting, Float(1.F)) * (Float(1.F) - fresnel);
  }

  Float reflecting, refracting;
  Float specular, clearcoat, diffuse;
};

// Fresnel term of the main reflection: metal and tint by Schlick, the rest exact.
Spectrum main_fresnel(const Parameters& p, Mask front, const InterfaceCrossing& x, Float exact,
                      Float refracting) {
  const Spectrum base = p.rgb(P::kBase);
  const Float metallic = p.number(P::kMetallic), tint = p.number(P::kSpecTint);
  const Float weight = schlick_weight(x.cos_o, x.eta);
  const Float dielectric = Float(1.F) - metallic;
  Spectrum f = schlick(base, weight) * metallic + splat(1.F) * (dielectric * exact);
  const Mask tinted = tint > Float(0.F);
  if (any(tinted)) {
    const Spectrum coloured = schlick(tint_of(base) * normal_reflectance(x.eta), weight);
    f = f + keep(tinted, (coloured - splat(1.F) * exact) * (dielectric * tint));
  }
  return select(front, f, splat(1.F) * (refracting * exact));
}

// Diffuse base and sheen, cosine included. Requires: both directions above the surface.
Spectrum base_value(const Parameters& p, const Vec3& wo, const Vec3& wi, Float cos_d,
                    Float reflecting) {
  const DiffuseTerms terms(wo.z, wi.z, cos_d, p.number(P::kRoughness), p.number(P::kFlatness));
  const Spectrum base = p.rgb(P::kBase);
  Spectrum value = base * (terms.diffuse * reflecting);
  const Float sheen = p.number(P::kSheen) * (Float(1.F) - p.number(P::kMetallic));
  const Mask lit = (sheen > Float(0.F)) & (reflecting > Float(0.F));
  if (any(lit)) {
    const Spectrum colour = mix(splat(1.F), tint_of(base), p.number(P::kSheenTint));
    value = value + keep(lit, colour * (sheen * terms.sheen));
  }
  return value * wi.z;
}

struct Coat {
  Float value, density;  // with cosine; of normals
};

// Burley 2012, section 5.5: fixed masking of roughness 0.25 and index 1.5 by Schlick.
Coat coat_value(const Parameters& p, const Vec3& wo, const Vec3& wi, const InterfaceCrossing& x) {
  const Gtr1 gtr(p.number(P::kGloss));
  const Roughness alpha{Float(0.25F), Float(0.25F)};
  const Float density = gtr.distribution(x.m);
  const Float weight = schlick_weight(x.cos_o, x.eta);
  const Float fresnel = Float(0.04F) + Float(0.96F) * weight;
  const Float masking = Ggx::masking(wo, alpha) * Ggx::masking(wi, alpha);
  return {Float(0.25F) * p.number(P::kClearcoat) * fresnel * density * masking * wi.z,
          density * x.m.z};
}

}  // namespace

Row PrincipledLobe::row(const scene::Principled& d) {
  // An index of 1 has no refraction that could be sampled (Mitsuba 3 moves it too).
  const bool refracts = d.spec_trans.value != 0;
  Row row;
  row.put(kBase, d.base_color);
  row.put(kRoughness, d.roughness);
  row.put(kAnisotropic, d.anisotropic);
  row.put(kMetallic, d.metallic);
  row.put(kSpecTrans, d.spec_trans);
  row.put(kSpecTint, d.spec_tint);
  row.put(kSheen, d.sheen);
  row.put(kSheenTint, d.sheen_tint);
  row.put(kFlatness, d.flatness);
  row.put(kClearcoat, d.clearcoat);
  row.put(kGloss, d.clearcoat_gloss);
  row.put(kEta, refracts && d.eta == 1 ? 1.001F : d.eta);
  row.put(kSpecularRate, d.main_specular_sampling_rate);
  row.put(kClearcoatRate, d.clearcoat_sampling_rate);
  row.put(kDiffuseRate, d.diffuse_reflectance_sampling_rate);
  return row;
}

Evaluation PrincipledLobe::evaluate(const Parameters& p, Mask lanes, const Vec3& wo, const Vec3& wi,
                                    Transport transport) {
  const Mask front = wo.z > Float(0.F);
  const Mixture mixture(p, front);
  const InterfaceCrossing x(wo, wi, p.number(kEta));
  const Mask active =
      lanes & (wo.z * wi.z != Float(0.F)) & (front | (mixture.refracting > Float(0.F)));
  const Mask reflect = active & x.reflect & x.compatible;
  const Mask refract = active & ~x.reflect & x.compatible & (mixture.refracting > Float(0.F));
  const Roughness alpha = principled_roughness(p.number(kRoughness), p.number(kAnisotropic));
  const Float exact = fresnel_dielectric(x.cos_o, x.eta).reflectance;
  const Float jacobian = x.jacobian();
  // Density of wi by visible normals.
  const Float visible = Ggx::distribution(x.m, alpha) * Ggx::masking(wo, alpha) * x.cos_o *
                        jacobian / xsimd::abs(wo.z);
  const Float specular = visible * Ggx::masking(wi, alpha);
  const Float crossing = mixture.crossing(front, exact);

  Evaluation e;
  // Between equal indices Mitsuba reflects nothing, not even from metal.
  const Mask mirrored = reflect & (x.eta != Float(1.F));
  e.value = keep(mirrored, main_fresnel(p, front, x, exact, mixture.refracting) * specular);
  e.pdf_solid_angle = keep(reflect, mixture.specular * (Float(1.F) - crossing) * visible);
  if (any(refract)) {
    const Spectrum base = p.rgb(kBase);
    const Spectrum root{safe_sqrt(base.x), safe_sqrt(base.y), safe_sqrt(base.z)};
    const Float scale = transport == Transport::kRadiance ? Float(1.F) / sqr(x.eta) : Float(1.F);
    const Float through = mixture.refracting * (Float(1.F) - exact) * specular * scale;
    e.value = select(refract, root * through, e.value);
    e.pdf_solid_angle = select(refract, mixture.specular * crossing * visible, e.pdf_solid_angle);
  }
  const Mask above = active & front & x.reflect;
  const Mask based = above & (mixture.reflecting > Float(0.F));
  if (any(based)) {
    e.value = e.value + keep(based, base_value(p, wo, wi, x.cos_i, mixture.reflecting));
    e.pdf_solid_angle = e.pdf_solid_angle + keep(based, mixture.diffuse * wi.z * Float(kInvPi));
  }
  const Mask coated = above & x.compatible & (p.number(kClearcoat) > Float(0.F));
  if (any(coated)) {
    const Coat coat = coat_value(p, wo, wi, x);
    e.value = e.value + splat(1.F) * keep(coated, coat.value);
    e.pdf_solid_angle =
        e.pdf_solid_angle + keep(coated, mixture.clearcoat * coat.density * jacobian);
  }
  return e;
}

Sample PrincipledLobe::sample(const Parameters& p, Mask lanes, const Vec3& wo, const SampleInput& u,
                              Transport transport) {
  const Mask front = wo.z > Float(0.F);
  const Mixture mixture(p, front);
  const Float side = select(front, Float(1.F), Float(-1.F));
  const Vec3 o{wo.x, wo.y, wo.z * side};
  const Float eta = select(front, p.number(kEta), Float(1.F) / p.number(kEta));
  const Roughness alpha = principled_roughness(p.number(kRoughness), p.number(kAnisotropic));
  const Mask diffuse = u.lobe < mixture.diffuse;
  const Float before_specular = mixture.diffuse + mixture.clearcoat;
  const Mask coated = ~diffuse & (u.lobe < before_specular);

  Vec3 m = Ggx::sample_normal(o, u.direction, alpha);
  if (any(lanes & coated)) {
    m = select(coated, Gtr1(p.number(kGloss)).sample_normal(u.direction), m);
  }
  const Float cos_o = dot(o, m);
  const DielectricInterface boundary = fresnel_dielectric(xsimd::abs(cos_o), eta);
  const Float crossing = mixture.crossing(front, boundary.reflectance);
  const Mask refract =
      ~diffuse & ~coated & (u.lobe < before_specular + mixture.specular * crossing);
  const Vec3 refracted = m * (cos_o / eta - boundary.cos_transmitted) - o * (Float(1.F) / eta);
  const Vec3 mirrored = m * (Float(2.F) * cos_o) - o;
  const Vec3 i = select(diffuse, square_to_cosine_hemisphere(u.direction),
                        select(refract, refracted, mirrored));
  Sample s;
  s.wi = {i.x, i.y, i.z * side};
  const Mask right_side =
      (select(refract, -i.z, i.z) > Float(0.F)) & (diffuse | (cos_o > Float(0.F)));
  const Evaluation e = evaluate(p, lanes & right_side, wo, s.wi, transport);
  s.pdf_solid_angle = e.pdf_solid_angle;
  s.valid = lanes & right_side & (s.pdf_solid_angle > Float(0.F));
  s.weight = keep(s.valid, e.value / s.pdf_solid_angle);
  s.eta = select(refract, eta, Float(1.F));
  return s;
}

}  // namespace metrofarm::bsdf
