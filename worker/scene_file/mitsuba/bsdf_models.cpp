#include "scene_file/mitsuba/bsdf_models.h"

#include <algorithm>

#include "scene_file/mitsuba/maximum.h"
#include "scene_file/mitsuba/surface_parameters.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

// Rough boundaries reflect and refract: with equal indices there is no half vector.
float read_boundary_ior(Properties& properties, std::string_view interior) {
  const float eta = read_relative_ior(properties, interior);
  if (eta == 1) {
    properties.problems().fail(properties.element().describe() +
                                   " needs different indices of refraction inside and outside",
                               properties.element().where);
  }
  return eta;
}

}  // namespace

BsdfModel load_diffuse(Properties& properties, Context& context) {
  // Mitsuba 0.6 knows the parameter by two names.
  const bool by_old_name = properties.element().legacy && properties.has("diffuse_reflectance");
  return scene::Diffuse{read_reflectance(
      properties, by_old_name ? "diffuse_reflectance" : "reflectance", 0.5F, context)};
}

BsdfModel load_rough_diffuse(Properties& properties, Context& context) {
  const scene::Scalar alpha = read_textured_number(properties, "alpha", 0.2, {0, 1e6}, context);
  properties.ignore({"use_fast_approx"});
  if (alpha.value != 0 || alpha.texture != scene::kNone) {
    context.problems.warn("bsdf \"roughdiffuse\" is rendered as \"diffuse\", without its roughness",
                          properties.element().where);
  }
  return load_diffuse(properties, context);
}

BsdfModel load_diffuse_transmitter(Properties& properties, Context& context) {
  return scene::DiffuseTransmitter{read_reflectance(properties, "transmittance", 0.5F, context)};
}

BsdfModel load_conductor(Properties& properties, Context& context) {
  const ConductorIndex index = read_conductor_index(properties, context);
  return scene::Conductor{index.eta, index.k,
                          read_reflectance(properties, "specular_reflectance", 1, context)};
}

BsdfModel load_rough_conductor(Properties& properties, Context& context) {
  scene::RoughConductor model;
  model.distribution = read_distribution(properties);
  const Roughness roughness = read_roughness(properties, context);
  model.alpha_u = roughness.u;
  model.alpha_v = roughness.v;
  const ConductorIndex index = read_conductor_index(properties, context);
  model.eta = index.eta;
  model.k = index.k;
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 1, context);
  return model;
}

BsdfModel load_dielectric(Properties& properties, Context& context) {
  scene::Dielectric model;
  model.eta = read_relative_ior(properties, "bk7");
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 1, context);
  model.specular_transmittance = read_reflectance(properties, "specular_transmittance", 1, context);
  return model;
}

BsdfModel load_thin_dielectric(Properties& properties, Context& context) {
  scene::ThinDielectric model;
  model.eta = read_relative_ior(properties, "bk7");
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 1, context);
  model.specular_transmittance = read_reflectance(properties, "specular_transmittance", 1, context);
  return model;
}

BsdfModel load_rough_dielectric(Properties& properties, Context& context) {
  scene::RoughDielectric model;
  model.distribution = read_distribution(properties);
  const Roughness roughness = read_roughness(properties, context);
  model.alpha_u = roughness.u;
  model.alpha_v = roughness.v;
  model.eta = read_boundary_ior(properties, "bk7");
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 1, context);
  model.specular_transmittance = read_reflectance(properties, "specular_transmittance", 1, context);
  return model;
}

BsdfModel load_plastic(Properties& properties, Context& context) {
  scene::Plastic model;
  model.eta = read_relative_ior(properties, "polypropylene");
  model.diffuse_reflectance = read_reflectance(properties, "diffuse_reflectance", 0.5F, context);
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 1, context);
  model.nonlinear = properties.boolean("nonlinear", false);
  return model;
}

BsdfModel load_rough_plastic(Properties& properties, Context& context) {
  scene::RoughPlastic model;
  model.distribution = read_distribution(properties);
  model.alpha = read_constant_alpha(properties);
  model.eta = read_boundary_ior(properties, "polypropylene");
  model.diffuse_reflectance = read_reflectance(properties, "diffuse_reflectance", 0.5F, context);
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 1, context);
  model.nonlinear = properties.boolean("nonlinear", false);
  return model;
}

BsdfModel load_phong(Properties& properties, Context& context) {
  scene::Phong model;
  model.exponent = read_textured_number(properties, "exponent", 30, {0, 1e6}, context);
  model.diffuse_reflectance = read_reflectance(properties, "diffuse_reflectance", 0.5F, context);
  model.specular_reflectance = read_reflectance(properties, "specular_reflectance", 0.2F, context);
  // As Mitsuba 0.6 where both together would reflect more than falls in.
  const scene::Rgb diffuse = maximum_of(model.diffuse_reflectance, context.scene);
  const scene::Rgb specular = maximum_of(model.specular_reflectance, context.scene);
  float brightest = 0;
  for (int i = 0; i < 3; ++i) brightest = std::max(brightest, diffuse[i] + specular[i]);
  if (brightest <= 1) return model;
  for (int i = 0; i < 3; ++i) {
    model.diffuse_reflectance.value[i] *= 0.99F / brightest;
    model.specular_reflectance.value[i] *= 0.99F / brightest;
  }
  return model;
}

BsdfModel load_null(Properties&, Context&) {
  return scene::Null{};
}

}  // namespace metrofarm::scene_file::mitsuba
