#include "scene_file/mitsuba/bsdfs.h"

#include <algorithm>

#include "scene_file/mitsuba/colours.h"
#include "scene_file/mitsuba/named_materials.h"
#include "scene_file/names.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Index;
using scene::Rgb;
using Model = decltype(scene::Bsdf::model);

constexpr Rgb kWhite = {1, 1, 1};

Model load_diffuse(Properties& properties, Context&) {
  return scene::Diffuse{
      read_colour(properties, "reflectance", {0.5F, 0.5F, 0.5F}, ColourUse::kReflectance)};
}

// A number or the name of a material.
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

ConductorIndex read_conductor_index(Properties& properties) {
  const Element* material = properties.find("material");
  if (material && (properties.has("eta") || properties.has("k"))) {
    properties.problems().fail("give either material or eta and k, not both", material->where);
  }
  if (material) {
    const std::string name = properties.text("material", "none");
    const std::optional<ConductorIndex> known = find_conductor(name);
    if (!known) {
      properties.problems().unsupported(
          "unknown conductor \"" + name + "\"" + suggestion(name, conductor_names()),
          material->where);
    }
    return known.value_or(*find_conductor("none"));
  }
  ConductorIndex index = {read_colour(properties, "eta", {0, 0, 0}, ColourUse::kIndex),
                          read_colour(properties, "k", kWhite, ColourUse::kIndex)};
  // Only Mitsuba 0.x has an exterior index for conductors.
  if (properties.element().legacy) {
    const auto exterior = static_cast<float>(read_ior(properties, "ext_eta", "vacuum"));
    for (int i = 0; i < 3; ++i) index.eta[i] /= exterior;
    for (int i = 0; i < 3; ++i) index.k[i] /= exterior;
  }
  return index;
}

Model load_conductor(Properties& properties, Context&) {
  const ConductorIndex index = read_conductor_index(properties);
  return scene::Conductor{
      index.eta, index.k,
      read_colour(properties, "specular_reflectance", kWhite, ColourUse::kReflectance)};
}

scene::Microfacet read_distribution(Properties& properties) {
  const std::string name = lower_case(properties.text("distribution", "beckmann"));
  if (name == "beckmann") return scene::Microfacet::kBeckmann;
  if (name == "ggx") return scene::Microfacet::kGgx;
  properties.problems().unsupported(
      "unknown microfacet distribution \"" + name + "\"" + suggestion(name, {"beckmann", "ggx"}),
      properties.find("distribution")->where);
  return scene::Microfacet::kBeckmann;
}

float read_alpha(Properties& properties, std::string_view name, double fallback) {
  // Mitsuba rounds smaller values up to this.
  constexpr double kSmallestAlpha = 1e-4;
  const double alpha = properties.number_in(name, fallback, 0, 1e6);
  return static_cast<float>(std::max(alpha, kSmallestAlpha));
}

void read_roughness(Properties& properties, scene::RoughConductor& model) {
  const bool has_u = properties.has("alpha_u");
  const bool has_v = properties.has("alpha_v");
  if (has_u != has_v || (has_u && properties.has("alpha"))) {
    properties.problems().fail("give either alpha or both alpha_u and alpha_v",
                               properties.find(has_u ? "alpha_u" : "alpha_v")->where);
    return;
  }
  model.alpha_u = read_alpha(properties, has_u ? "alpha_u" : "alpha", 0.1);
  model.alpha_v = read_alpha(properties, has_v ? "alpha_v" : "alpha", 0.1);
}

Model load_rough_conductor(Properties& properties, Context&) {
  scene::RoughConductor model;
  model.distribution = read_distribution(properties);
  read_roughness(properties, model);
  const ConductorIndex index = read_conductor_index(properties);
  model.eta = index.eta;
  model.k = index.k;
  model.specular_reflectance =
      read_colour(properties, "specular_reflectance", kWhite, ColourUse::kReflectance);
  properties.ignore({"sample_visible"});
  return model;
}

Model load_dielectric(Properties& properties, Context&) {
  scene::Dielectric model;
  model.eta = static_cast<float>(read_ior(properties, "int_ior", "bk7") /
                                 read_ior(properties, "ext_ior", "air"));
  model.specular_reflectance =
      read_colour(properties, "specular_reflectance", kWhite, ColourUse::kReflectance);
  model.specular_transmittance =
      read_colour(properties, "specular_transmittance", kWhite, ColourUse::kReflectance);
  return model;
}

bool transmits(Index bsdf, const Context& context) {
  return std::holds_alternative<scene::Dielectric>(context.scene.bsdfs[bsdf].model);
}

Model load_twosided(Properties& properties, Context& context) {
  const std::vector<const Element*> nested = properties.objects("bsdf");
  if (nested.empty() || nested.size() > 2) {
    context.problems.fail(
        "a twosided bsdf needs one or two nested bsdfs, for the front and the "
        "back",
        properties.element().where);
    return scene::Diffuse{};
  }
  const Index front = load_bsdf(*nested[0], context);
  const Index back = nested.size() == 2 ? load_bsdf(*nested[1], context) : front;
  if (context.problems.failed()) return scene::Diffuse{};
  if (transmits(front, context) || transmits(back, context)) {
    context.problems.fail(
        "a bsdf inside twosided must only reflect: a dielectric already has two "
        "sides, use it without twosided",
        properties.element().where);
  }
  return scene::TwoSided{front, back};
}

constexpr Plugin<Model (*)(Properties&, Context&)> kBsdfs[] = {
    {"diffuse", load_diffuse},
    {"conductor", load_conductor},
    {"roughconductor", load_rough_conductor},
    {"dielectric", load_dielectric},
    {"twosided", load_twosided},
};

Index append_bsdf(const Model& model, const Element& element, Context& context) {
  context.scene.bsdfs.push_back({model, element.get("id"), element.where});
  return static_cast<Index>(context.scene.bsdfs.size() - 1);
}

}  // namespace

Index load_bsdf(const Element& element, Context& context) {
  if (const auto it = context.bsdfs.find(&element); it != context.bsdfs.end()) return it->second;
  if (!context.bsdfs_in_progress.insert(&element).second) {
    context.problems.fail(element.describe() + " contains itself", element.where);
    return default_bsdf(false, context);
  }
  Model model = scene::Diffuse{};
  const auto* plugin =
      find_plugin(kBsdfs, element, "a grey diffuse bsdf takes its place", context.problems);
  if (plugin) {
    Properties properties = context.properties_of(element);
    model = plugin->load(properties, context);
    properties.finish();
  }
  context.bsdfs_in_progress.erase(&element);
  const Index index = append_bsdf(model, element, context);
  context.bsdfs.emplace(&element, index);
  return index;
}

Index default_bsdf(bool for_emitter, Context& context) {
  Index& index = for_emitter ? context.black_bsdf : context.default_bsdf;
  if (index == scene::kNone) {
    const float reflectance = for_emitter ? 0.0F : 0.5F;
    index =
        append_bsdf(scene::Diffuse{{reflectance, reflectance, reflectance}}, Element{}, context);
  }
  return index;
}

}  // namespace metrofarm::scene_file::mitsuba
