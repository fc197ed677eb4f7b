#include "tests/bsdf/cases.h"

#include <cmath>

namespace metrofarm::bsdf::test {
namespace {

using scene::Microfacet;

constexpr scene::Rgb kEta = {0.2F, 0.9F, 1.1F}, kK = {3.9F, 2.4F, 2.1F};
constexpr scene::Rgb kBlueish = {0.2F, 0.5F, 0.8F};

template <class Model>
MaterialCase make(std::string name, const Model& model, double alpha = 1,
                  Below below = Below::kNothing, double eta = 1) {
  return {std::move(name), {model, "", {}}, alpha, alpha, below, eta};
}

template <class Model>
Model with_roughness(Microfacet distribution, float alpha_u, float alpha_v) {
  Model m;
  m.distribution = distribution;
  m.alpha_u = {alpha_u};
  m.alpha_v = {alpha_v};
  return m;
}

scene::RoughConductor metal(Microfacet distribution, float alpha_u, float alpha_v) {
  auto m = with_roughness<scene::RoughConductor>(distribution, alpha_u, alpha_v);
  m.eta = kEta;
  m.k = kK;
  return m;
}

scene::RoughDielectric glass(Microfacet distribution, float alpha_u, float alpha_v) {
  auto m = with_roughness<scene::RoughDielectric>(distribution, alpha_u, alpha_v);
  m.eta = 1.5F;
  return m;
}

scene::RoughPlastic plastic(Microfacet distribution, float alpha, bool nonlinear,
                            const scene::Rgb& diffuse) {
  scene::RoughPlastic m;
  m.distribution = distribution;
  m.alpha = alpha;
  m.eta = 1.49F;
  m.nonlinear = nonlinear;
  m.diffuse_reflectance = {diffuse};
  return m;
}

std::string per_mille(double v) {
  return "_" + std::to_string(std::lround(1000 * v));
}

void add_rough_cases(std::vector<MaterialCase>& cases, Microfacet d, const std::string& tag) {
  for (float alpha : {0.01F, 0.1F, 0.5F, 1.F}) {
    const std::string size = tag + per_mille(alpha);
    cases.push_back(make("roughconductor_" + size, metal(d, alpha, alpha), alpha));
    cases.push_back(
        make("roughdielectric_" + size, glass(d, alpha, alpha), alpha, Below::kRefracted, 1.5));
  }
  auto brushed = metal(d, 0.3F, 0.05F);
  brushed.specular_reflectance = {0.5F, 0.7F, 0.9F};
  cases.push_back(make("roughconductor_" + tag + "_300_50", brushed));
  auto frosted = glass(d, 0.05F, 0.3F);
  frosted.specular_reflectance = {0.5F, 0.7F, 0.9F};
  frosted.specular_transmittance = {0.9F, 0.6F, 0.3F};
  cases.push_back(make("roughdielectric_" + tag + "_50_300", frosted));
  for (float alpha : {0.05F, 0.3F}) {
    for (bool nonlinear : {false, true}) {
      cases.push_back(
          make("roughplastic_" + tag + per_mille(alpha) + (nonlinear ? "_nonlinear" : ""),
               plastic(d, alpha, nonlinear, kBlueish)));
    }
  }
}

void add_principled_cases(std::vector<MaterialCase>& cases, const scene::Rgb& base) {
  scene::Principled plain, shiny, cloth, clear;
  for (auto* m : {&plain, &shiny, &cloth, &clear}) m->base_color = {base};
  shiny.metallic = {0.7F};
  shiny.roughness = {0.3F};
  shiny.anisotropic = {0.8F};
  shiny.spec_tint = {0.6F};
  shiny.eta = 1.7F;
  cloth.sheen = {0.8F};
  cloth.sheen_tint = {0.5F};
  cloth.flatness = {0.6F};
  cloth.roughness = {0.7F};
  cloth.clearcoat = {0.9F};
  cloth.clearcoat_gloss = {0.3F};
  clear.spec_trans = {0.8F};
  clear.roughness = {0.4F};
  clear.metallic = {0.1F};
  clear.clearcoat = {0.5F};
  clear.clearcoat_gloss = {0.5F};
  plain.eta = static_cast<float>(2 / (1 - std::sqrt(0.08 * 0.5)) - 1);  // specular = 0.5
  cases.push_back(make("principled", plain, 0.25));
  cases.push_back(make("principled_metal", shiny, 0.05));
  cases.push_back(make("principled_cloth", cloth, 0.05));
  cases.push_back(make("principled_glass", clear, 0.05, Below::kRefracted, 1.5));
  scene::PrincipledThin leaf, sheet;
  for (auto* m : {&leaf, &sheet}) m->base_color = {base};
  sheet.spec_trans = {0.6F};
  sheet.diff_trans = {0.7F};
  sheet.anisotropic = {0.5F};
  sheet.spec_tint = {0.4F};
  sheet.sheen = {0.5F};
  sheet.sheen_tint = {0.6F};
  sheet.flatness = {0.3F};
  sheet.eta = {1.33F};
  cases.push_back(make("principledthin", leaf, 0.25, Below::kMirrored));
  cases.push_back(make("principledthin_sheet", sheet, 0.15, Below::kMirrored));
  for (size_t i = cases.size() - 6; i < cases.size(); ++i) cases[i].most_energy = 1.45;
  // Mitsuba's thin sheet is not symmetric, and ours agrees with it.
  cases.back().reciprocal = false;
}

}  // namespace

std::vector<MaterialCase> mitsuba_cases() {
  std::vector<MaterialCase> cases = {make("diffuse", scene::Diffuse{{kBlueish}})};
  add_rough_cases(cases, Microfacet::kBeckmann, "beckmann");
  add_rough_cases(cases, Microfacet::kGgx, "ggx");
  for (bool nonlinear : {false, true}) {
    scene::Plastic m{1.49F, {kBlueish}, {0.9F, 0.8F, 0.7F}, nonlinear};
    cases.push_back(make(nonlinear ? "plastic_nonlinear" : "plastic", m));
  }
  add_principled_cases(cases, kBlueish);
  return cases;
}

std::vector<MaterialCase> white_cases() {
  const scene::Rgb white = {1, 1, 1};
  std::vector<MaterialCase> cases = {
      make("diffuse", scene::Diffuse{{white}}),
      make("difftrans", scene::DiffuseTransmitter{{white}}, 1, Below::kMirrored)};
  for (auto d : {Microfacet::kBeckmann, Microfacet::kGgx}) {
    const std::string tag = d == Microfacet::kGgx ? "ggx" : "beckmann";
    for (float alpha : {0.001F, 0.01F, 0.1F, 0.5F, 1.F}) {
      const std::string size = tag + per_mille(alpha);
      // No index, so no absorption.
      cases.push_back(make("roughconductor_" + size,
                           with_roughness<scene::RoughConductor>(d, alpha, alpha), alpha));
      cases.push_back(
          make("roughdielectric_" + size, glass(d, alpha, alpha), alpha, Below::kRefracted, 1.5));
      cases.push_back(make("roughplastic_" + size, plastic(d, alpha, false, white), alpha));
    }
    cases.push_back(make("roughconductor_" + tag + "_300_50",
                         with_roughness<scene::RoughConductor>(d, 0.3F, 0.05F)));
    cases.back().alpha_u = 0.3;
    cases.back().alpha_v = 0.05;
    cases.push_back(make("roughdielectric_" + tag + "_50_300", glass(d, 0.05F, 0.3F), 1,
                         Below::kRefracted, 1.5));
    cases.back().alpha_u = 0.05;
    cases.back().alpha_v = 0.3;
  }
  for (float exponent : {5.F, 100.F, 100000.F}) {
    cases.push_back(make("phong" + per_mille(exponent / 1000),
                         scene::Phong{{exponent}, {0.5F, 0.5F, 0.5F}, {0.5F, 0.5F, 0.5F}},
                         std::sqrt(2 / (exponent + 2))));
  }
  cases.push_back(make("plastic", scene::Plastic{1.49F, {white}, {}, true}));
  add_principled_cases(cases, white);
  return cases;
}

Shown::Shown(std::vector<scene::Bsdf> bsdfs, std::vector<scene::Texture> textures,
             std::vector<scene::Image> images)
    : images_(std::move(images)),
      texture_list_(std::move(textures)),
      textures_(texture_list_, images_, primitives_),
      bsdfs_(std::move(bsdfs)),
      materials_(bsdfs_, textures_) {}

ShownLobe Shown::lobe(const Vec3& wo, Float choice, float u, float v) const {
  ShadingPoint at;
  at.point = {{Float(u), Float(v)}, Int(0), Float(0.3F), Float(0.3F)};
  at.dp_du = splat(1, 0, 0);
  at.dp_dv = splat(0, 1, 0);
  at.wo = wo;
  return materials_.show(Int(0), at, choice, all_lanes());
}

std::unique_ptr<Chart> chart_of(const MaterialCase& c, metrofarm::test::Double3 wo) {
  const bool lobes = c.alpha_u < 1 || c.alpha_v < 1 || c.below == Below::kRefracted;
  if (!lobes) return std::make_unique<SphereChart>();
  return std::make_unique<FacetChart>(wo, c.alpha_u, c.alpha_v, c.below, c.eta);
}

}  // namespace metrofarm::bsdf::test
