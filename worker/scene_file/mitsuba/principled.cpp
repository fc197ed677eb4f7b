#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "scene_file/mitsuba/bsdf_models.h"
#include "scene_file/mitsuba/surface_parameters.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

constexpr Range kUnit = {0, 1};

// How often a lobe is sampled: 0 or more, compared with the others.
float read_rate(Properties& properties, std::string_view name) {
  return static_cast<float>(properties.number_in(name, 1, 0, 1e6));
}

// Without any rate a lobe could not be sampled at all.
void require_a_rate(Properties& properties, std::initializer_list<float> rates) {
  if (std::any_of(rates.begin(), rates.end(), [](float rate) { return rate > 0; })) return;
  properties.problems().fail(
      "one of the sampling rates of " + properties.element().describe() + " must be greater than 0",
      properties.element().where);
}

// eta, or Disney's "specular" for which 0.5 is eta 1.5 (Burley 2012, section 5.5).
float read_specular_or_eta(Properties& properties) {
  const Element* specular = properties.find("specular");
  if (specular && properties.has("eta")) {
    properties.problems().fail("give either specular or eta, not both", specular->where);
  }
  if (properties.has("eta")) {
    return static_cast<float>(properties.number_in("eta", 1.5, 1e-3, 1e3));
  }
  // Twelve and a half would be an infinite eta.
  const double value = properties.number_in("specular", 0.5, 0, 12);
  return static_cast<float>(2 / (1 - std::sqrt(0.08 * value)) - 1);
}

}  // namespace

BsdfModel load_principled(Properties& properties, Context& context) {
  const auto unit = [&](std::string_view name, double fallback) {
    return read_textured_number(properties, name, fallback, kUnit, context);
  };
  scene::Principled model;
  model.base_color = read_reflectance(properties, "base_color", 0.5F, context);
  model.roughness = unit("roughness", 0.5);
  model.anisotropic = unit("anisotropic", 0);
  model.metallic = unit("metallic", 0);
  model.spec_trans = unit("spec_trans", 0);
  model.spec_tint = unit("spec_tint", 0);
  model.sheen = unit("sheen", 0);
  model.sheen_tint = unit("sheen_tint", 0);
  model.flatness = unit("flatness", 0);
  model.clearcoat = unit("clearcoat", 0);
  model.clearcoat_gloss = unit("clearcoat_gloss", 0);
  model.eta = read_specular_or_eta(properties);
  model.main_specular_sampling_rate = read_rate(properties, "main_specular_sampling_rate");
  model.clearcoat_sampling_rate = read_rate(properties, "clearcoat_sampling_rate");
  model.diffuse_reflectance_sampling_rate =
      read_rate(properties, "diffuse_reflectance_sampling_rate");
  require_a_rate(properties, {model.main_specular_sampling_rate, model.clearcoat_sampling_rate,
                              model.diffuse_reflectance_sampling_rate});
  return model;
}

BsdfModel load_principled_thin(Properties& properties, Context& context) {
  const auto unit = [&](std::string_view name, double fallback) {
    return read_textured_number(properties, name, fallback, kUnit, context);
  };
  scene::PrincipledThin model;
  model.base_color = read_reflectance(properties, "base_color", 0.5F, context);
  model.roughness = unit("roughness", 0.5);
  model.anisotropic = unit("anisotropic", 0);
  model.spec_trans = unit("spec_trans", 0);
  model.diff_trans = read_textured_number(properties, "diff_trans", 0, {0, 2}, context);
  model.eta = read_textured_number(properties, "eta", 1.5, {1e-3, 1e3}, context);
  model.spec_tint = unit("spec_tint", 0);
  model.sheen = unit("sheen", 0);
  model.sheen_tint = unit("sheen_tint", 0);
  model.flatness = unit("flatness", 0);
  model.spec_reflectance_sampling_rate =
      read_rate(properties, "specular_reflectance_sampling_rate");
  model.spec_transmittance_sampling_rate =
      read_rate(properties, "specular_transmittance_sampling_rate");
  model.diffuse_reflectance_sampling_rate =
      read_rate(properties, "diffuse_reflectance_sampling_rate");
  model.diffuse_transmittance_sampling_rate =
      read_rate(properties, "diffuse_transmittance_sampling_rate");
  require_a_rate(
      properties,
      {model.spec_reflectance_sampling_rate, model.spec_transmittance_sampling_rate,
       model.diffuse_reflectance_sampling_rate, model.diffuse_transmittance_sampling_rate});
  return model;
}

}  // namespace metrofarm::scene_file::mitsuba
