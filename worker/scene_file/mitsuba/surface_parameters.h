// Parameters that several <bsdf> plugins have in common.
#pragma once

#include <string_view>

#include "scene_file/mitsuba/textures.h"
#include "scene_file/named_materials.h"

namespace metrofarm::scene_file::mitsuba {

// A reflectance or transmittance, white or grey unless given.
scene::Colour read_reflectance(Properties& properties, std::string_view name, float fallback,
                               Context& context);

// An index of refraction: a number or the name of a material.
double read_ior(Properties& properties, std::string_view name, std::string_view fallback);

// int_ior over ext_ior.
float read_relative_ior(Properties& properties, std::string_view interior);

ConductorIndex read_conductor_index(Properties& properties, Context& context);

scene::Microfacet read_distribution(Properties& properties);

struct Roughness {
  scene::Scalar u = {0.1F};
  scene::Scalar v = {0.1F};
};

// alpha, or alpha_u and alpha_v.
Roughness read_roughness(Properties& properties, Context& context);

// Roughness of plugins that take only one number for it.
float read_constant_alpha(Properties& properties);

}  // namespace metrofarm::scene_file::mitsuba
