#include "bsdf/lobes.h"

#include "base/check.h"

namespace metrofarm::bsdf {

int ParameterTable::add_row(std::initializer_list<float> values) {
  METROFARM_CHECK(values.size() <= kColumns);
  int column = 0;
  for (float v : values) columns_[column++].push_back(v);
  while (column < kColumns) columns_[column++].push_back(0.F);
  return static_cast<int>(columns_[0].size()) - 1;
}

Evaluation DiffuseLobe::evaluate(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                                 const Vec3& wi) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  const Float pdf = keep(lit, wi.z * Float(kInvPi));
  return {table.get_rgb(0, row, lanes) * pdf, pdf};
}

Sample DiffuseLobe::sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                           const SampleInput& u) {
  Sample s;
  s.wi = square_to_cosine_hemisphere(u.direction);
  s.pdf_solid_angle = s.wi.z * Float(kInvPi);
  s.weight = table.get_rgb(0, row, lanes);
  s.valid = lanes & (wo.z > Float(0.F)) & (s.pdf_solid_angle > Float(0.F));
  return s;
}

Sample ConductorLobe::sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                             const SampleInput& /*u*/) {
  Sample s;
  s.wi = {-wo.x, -wo.y, wo.z};
  s.valid = lanes & (wo.z > Float(0.F));
  s.delta = s.valid;
  const Spectrum fresnel =
      fresnel_conductor(wo.z, table.get_rgb(0, row, lanes), table.get_rgb(3, row, lanes));
  s.weight = fresnel * table.get_rgb(6, row, lanes);
  return s;
}

template <class Distribution>
Evaluation RoughConductorLobe<Distribution>::evaluate(const ParameterTable& table, Int row,
                                                      Mask lanes, const Vec3& wo, const Vec3& wi) {
  const Mask lit = lanes & (wo.z > Float(0.F)) & (wi.z > Float(0.F));
  if (none(lit)) return {};
  const Roughness alpha{table.get(9, row, lanes), table.get(10, row, lanes)};
  const Vec3 m = normalize(wo + wi);
  const Float cos_m = dot(wo, m);
  const Float density = Distribution::distribution(m, alpha);
  const Float shadowing = Distribution::masking(wo, alpha) * Distribution::masking(wi, alpha);
  const Float reflected = density * shadowing / (Float(4.F) * wo.z);
  const Spectrum fresnel =
      fresnel_conductor(cos_m, table.get_rgb(0, row, lanes), table.get_rgb(3, row, lanes));
  const Float pdf = Distribution::pdf_normal(wo, m, alpha) / (Float(4.F) * cos_m);
  const Mask defined = lit & (density > Float(0.F));
  return {keep(defined, fresnel * table.get_rgb(6, row, lanes) * reflected), keep(defined, pdf)};
}

template <class Distribution>
Sample RoughConductorLobe<Distribution>::sample(const ParameterTable& table, Int row, Mask lanes,
                                                const Vec3& wo, const SampleInput& u) {
  Sample s;
  const Roughness alpha{table.get(9, row, lanes), table.get(10, row, lanes)};
  const Vec3 m = Distribution::sample_normal(wo, u.direction, alpha);
  s.wi = m * (Float(2.F) * dot(wo, m)) - wo;
  const Evaluation e = evaluate(table, row, lanes, wo, s.wi);
  s.pdf_solid_angle = e.pdf_solid_angle;
  s.valid = lanes & (s.pdf_solid_angle > Float(0.F));
  s.weight = keep(s.valid, e.value / s.pdf_solid_angle);
  return s;
}

template struct RoughConductorLobe<Ggx>;
template struct RoughConductorLobe<Beckmann>;

Sample DielectricLobe::sample(const ParameterTable& table, Int row, Mask lanes, const Vec3& wo,
                              const SampleInput& u) {
  const Float interior = table.get(0, row, lanes);
  const Mask entering = wo.z > Float(0.F);
  const Float eta = select(entering, interior, Float(1.F) / interior);
  const Float cos_o = xsimd::abs(wo.z);
  const DielectricInterface boundary = fresnel_dielectric(cos_o, eta);
  const Mask reflect = u.lobe < boundary.reflectance;
  const Float inverse_eta = Float(1.F) / eta;
  const Float cos_t = select(entering, -boundary.cos_transmitted, boundary.cos_transmitted);
  const Vec3 refracted{-wo.x * inverse_eta, -wo.y * inverse_eta, cos_t};
  Sample s;
  s.wi = select(reflect, Vec3{-wo.x, -wo.y, wo.z}, refracted);
  s.weight = select(reflect, table.get_rgb(1, row, lanes),
                    table.get_rgb(4, row, lanes) * sqr(inverse_eta));
  s.eta = select(reflect, Float(1.F), eta);
  s.valid = lanes & (cos_o > Float(0.F));
  s.delta = s.valid;
  return s;
}

}  // namespace metrofarm::bsdf
