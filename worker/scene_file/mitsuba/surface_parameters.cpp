#include "scene_file/mitsuba/surface_parameters.h"

#include <algorithm>

#include "scene_file/names.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Rgb;
using scene::Scalar;

// Mitsuba rounds smaller values up to this.
constexpr float kSmallestAlpha = 1e-4F;
constexpr Range kAlphaRange = {0, 1e6};

Scalar read_alpha(Properties& properties, std::string_view name, Context& context) {
  Scalar alpha = read_textured_number(properties, name, 0.1, kAlphaRange, context);
  if (alpha.texture == scene::kNone) alpha.value = std::max(alpha.value, kSmallestAlpha);
  return alpha;
}

bool has_one_of_alphas(Properties& properties) {
  const bool has_u = properties.has("alpha_u");
  const bool has_v = properties.has("alpha_v");
  if (has_u == has_v && !(has_u && properties.has("alpha"))) return true;
  properties.problems().fail("give either alpha or both alpha_u and alpha_v",
                             properties.find(has_u ? "alpha_u" : "alpha_v")->where);
  return false;
}

ConductorIndex named_conductor(const std::string& name, const SourceLocation& where,
                               Problems& problems) {
  const std::optional<ConductorIndex> known =
      find_conductor(lower_case(name) == "none" ? "none" : name);
  if (!known) {
    problems.unsupported("unknown conductor \"" + name + "\"" + suggestion(name, conductor_names()),
                         where);
  }
  return known.value_or(*find_conductor("none"));
}

}  // namespace

scene::Colour read_reflectance(Properties& properties, std::string_view name, float fallback,
                               Context& context) {
  return read_textured_colour(properties, name, Rgb{fallback, fallback, fallback},
                              ColourUse::kReflectance, context);
}

double read_ior(Properties& properties, std::string_view name, std::string_view fallback) {
  const Element* element = properties.find(name);
  if (element && element->tag == "string") {
    const std::optional<double> ior = find_ior(element->get("value"));
    if (!ior) {
      properties.problems().fail("unknown material \"" + element->get("value") + "\" for \"" +
                                     std::string(name) + "\"; a number is written <float name=\"" +
                                     std::string(name) + "\" .../>" +
                                     suggestion(element->get("value"), ior_names()),
                                 element->where);
    }
    return ior.value_or(1);
  }
  const double ior = properties.number(name, *find_ior(fallback));
  if (ior > 0) return ior;
  properties.problems().fail("parameter \"" + std::string(name) + "\" must be greater than 0",
                             element->where);
  return 1;
}

float read_relative_ior(Properties& properties, std::string_view interior) {
  const double inside = read_ior(properties, "int_ior", interior);
  return static_cast<float>(inside / read_ior(properties, "ext_ior", "air"));
}

ConductorIndex read_conductor_index(Properties& properties, Context& context) {
  const bool legacy = properties.element().legacy;
  const Element* material = properties.find("material");
  if (material && !legacy && (properties.has("eta") || properties.has("k"))) {
    properties.problems().fail("give either material or eta and k, not both", material->where);
  }
  // Mitsuba 0.x takes copper where nothing is said, and lets eta and k replace those of a material.
  const ConductorIndex named =
      named_conductor(properties.text("material", legacy ? "Cu" : "none"),
                      material ? material->where : properties.element().where, context.problems);
  ConductorIndex index = {read_colour(properties, "eta", named.eta, ColourUse::kIndex, context),
                          read_colour(properties, "k", named.k, ColourUse::kIndex, context)};
  if (!legacy) return index;
  // Only Mitsuba 0.x has an exterior index for conductors.
  const auto exterior = static_cast<float>(read_ior(properties, "ext_eta", "air"));
  for (int i = 0; i < 3; ++i) index.eta[i] /= exterior;
  for (int i = 0; i < 3; ++i) index.k[i] /= exterior;
  return index;
}

scene::Microfacet read_distribution(Properties& properties) {
  // How normals are sampled: no part of the image.
  properties.ignore({"sample_visible"});
  const std::string name = lower_case(properties.text("distribution", "beckmann"));
  if (name == "beckmann") return scene::Microfacet::kBeckmann;
  if (name == "ggx") return scene::Microfacet::kGgx;
  const bool is_phong = properties.element().legacy && (name == "phong" || name == "as");
  properties.problems().unsupported(
      is_phong ? "the microfacet distribution \"" + name +
                     "\" of Mitsuba 0.6 is not supported; the nearest is \"beckmann\""
               : "unknown microfacet distribution \"" + name + "\"" +
                     suggestion(name, {"beckmann", "ggx"}),
      properties.find("distribution")->where);
  return scene::Microfacet::kBeckmann;
}

Roughness read_roughness(Properties& properties, Context& context) {
  if (!has_one_of_alphas(properties)) return {};
  const bool two = properties.has("alpha_u");
  return {read_alpha(properties, two ? "alpha_u" : "alpha", context),
          read_alpha(properties, two ? "alpha_v" : "alpha", context)};
}

float read_constant_alpha(Properties& properties) {
  const double alpha = properties.number_in("alpha", 0.1, kAlphaRange.lowest, kAlphaRange.highest);
  return std::max(static_cast<float>(alpha), kSmallestAlpha);
}

}  // namespace metrofarm::scene_file::mitsuba
