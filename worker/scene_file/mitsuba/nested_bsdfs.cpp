#include "scene_file/mitsuba/nested_bsdfs.h"

#include <numeric>

#include "scene_file/mitsuba/bsdfs.h"
#include "scene_file/mitsuba/textures.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Index;

// Whether light may pass through a surface of this material. Requires: what it nests is loaded.
bool transmits(Index index, const Context& context) {
  const auto& model = context.scene.bsdfs[static_cast<size_t>(index)].model;
  if (const auto* principled = std::get_if<scene::Principled>(&model)) {
    return principled->spec_trans.value > 0;
  }
  if (const auto* blend = std::get_if<scene::Blend>(&model)) {
    return transmits(blend->first, context) || transmits(blend->second, context);
  }
  if (const auto* bump = std::get_if<scene::BumpMap>(&model)) {
    return transmits(bump->nested, context);
  }
  if (const auto* normal = std::get_if<scene::NormalMap>(&model)) {
    return transmits(normal->nested, context);
  }
  return std::holds_alternative<scene::Dielectric>(model) ||
         std::holds_alternative<scene::ThinDielectric>(model) ||
         std::holds_alternative<scene::RoughDielectric>(model) ||
         std::holds_alternative<scene::PrincipledThin>(model) ||
         std::holds_alternative<scene::DiffuseTransmitter>(model) ||
         std::holds_alternative<scene::Null>(model) || std::holds_alternative<scene::Mask>(model);
}

// The only nested bsdf; kNone after a problem.
Index load_nested(Properties& properties, Context& context) {
  const Element* nested = properties.object("bsdf");
  if (nested) return load_bsdf(*nested, context);
  context.problems.fail(properties.element().describe() + " needs a nested bsdf",
                        properties.element().where);
  return scene::kNone;
}

Index append(BsdfModel model, const Element& element, Context& context) {
  context.scene.bsdfs.push_back({model, "", element.where});
  return static_cast<Index>(context.scene.bsdfs.size() - 1);
}

std::vector<double> read_weights(Properties& properties, size_t count) {
  const Element* element = properties.find("weights");
  const SourceLocation& where = element ? element->where : properties.element().where;
  const auto weights = parse_doubles(properties.text("weights", ""));
  bool valid = weights && weights->size() == count && count > 0;
  for (size_t i = 0; valid && i < count; ++i) valid = (*weights)[i] >= 0;
  if (valid) return *weights;
  properties.problems().fail(
      "bsdf \"mixturebsdf\" needs as many weights of 0 or more as nested bsdfs (" +
          std::to_string(count) + "), as in <string name=\"weights\" value=\"0.3, 0.7\"/>",
      where);
  return {};
}

}  // namespace

BsdfModel load_twosided(Properties& properties, Context& context) {
  const std::vector<const Element*> nested = properties.objects("bsdf");
  if (nested.empty() || nested.size() > 2) {
    context.problems.fail(
        "a twosided bsdf needs one or two nested bsdfs, for the front and the back",
        properties.element().where);
    return scene::Diffuse{};
  }
  const Index front = load_bsdf(*nested[0], context);
  const Index back = nested.size() == 2 ? load_bsdf(*nested[1], context) : front;
  if (context.problems.failed()) return scene::Diffuse{};
  if (transmits(front, context) || transmits(back, context)) {
    const Element& culprit = transmits(front, context) ? *nested[0] : *nested[1];
    context.problems.fail("a bsdf inside twosided must only reflect: " + culprit.describe() +
                              " already has two sides, use it without twosided",
                          properties.element().where);
  }
  return scene::TwoSided{front, back};
}

BsdfModel load_mask(Properties& properties, Context& context) {
  scene::Mask mask;
  mask.opacity = read_textured_number(properties, "opacity", 0.5, {0, 1}, context);
  mask.nested = load_nested(properties, context);
  return mask;
}

BsdfModel load_blend(Properties& properties, Context& context) {
  scene::Blend blend;
  if (!properties.has("weight")) {
    context.problems.fail(
        "bsdf \"blendbsdf\" needs a weight: 0 is the first of its two bsdfs, 1 "
        "the second",
        properties.element().where);
  }
  blend.weight = read_textured_number(properties, "weight", 0.5, {0, 1}, context);
  const std::vector<const Element*> nested = properties.objects("bsdf");
  if (nested.size() != 2) {
    context.problems.fail(
        "bsdf \"blendbsdf\" needs two nested bsdfs, not " + std::to_string(nested.size()),
        properties.element().where);
    return scene::Diffuse{};
  }
  blend.first = load_bsdf(*nested[0], context);
  blend.second = load_bsdf(*nested[1], context);
  return blend;
}

BsdfModel load_mixture(Properties& properties, Context& context) {
  std::vector<Index> parts;
  for (const Element* nested : properties.objects("bsdf")) {
    parts.push_back(load_bsdf(*nested, context));
  }
  std::vector<double> weights = read_weights(properties, parts.size());
  if (context.problems.failed()) return scene::Diffuse{};
  // Weights of less than 1 leave the rest of the light to be absorbed; more are scaled down.
  const double missing = 1 - std::accumulate(weights.begin(), weights.end(), 0.0);
  constexpr double kRounding = 1e-6;
  if (missing > kRounding) {
    parts.push_back(append(scene::Diffuse{{0, 0, 0}}, properties.element(), context));
    weights.push_back(missing);
  }
  if (parts.size() == 1) return context.scene.bsdfs[static_cast<size_t>(parts[0])].model;
  Index rest = parts.back();
  double rest_weight = weights.back();
  for (size_t i = parts.size() - 1; i-- > 0;) {
    rest_weight += weights[i];
    const double weight = rest_weight > 0 ? 1 - weights[i] / rest_weight : 0;
    const scene::Blend blend = {static_cast<float>(weight), parts[i], rest};
    if (i == 0) return blend;
    rest = append(blend, properties.element(), context);
  }
  return scene::Diffuse{};  // not reached: there are two parts or more
}

// How Mitsuba 3.9 treats bent normals unless told otherwise is the only way that we do.
void require_bent_normal_defaults(Properties& properties) {
  for (const char* name : {"flip_invalid_normals", "use_shadowing_function"}) {
    if (properties.boolean(name, true)) continue;
    properties.problems().unsupported("\"" + std::string(name) + "\" can only be true",
                                      properties.find(name)->where);
  }
}

BsdfModel load_bump_map(Properties& properties, Context& context) {
  const auto scale = static_cast<float>(properties.number("scale", 1));
  require_bent_normal_defaults(properties);
  const Element* texture = find_nested_texture(properties, "scale");
  scene::BumpMap bump;
  bump.nested = load_nested(properties, context);
  if (!texture) {
    context.problems.fail("bsdf \"bumpmap\" needs a nested texture of displacements",
                          properties.element().where);
    return bump;
  }
  const scene::Colour height = load_textured_colour(*texture, ColourUse::kIndex, context);
  if (height.value[0] != height.value[1] || height.value[1] != height.value[2]) {
    context.problems.unsupported("displacements can be scaled by a number only, not by a colour",
                                 texture->where);
  }
  bump.displacement = {height.value[0] * scale, height.texture};
  return bump;
}

BsdfModel load_normal_map(Properties& properties, Context& context) {
  require_bent_normal_defaults(properties);
  const Element* texture = properties.find("normalmap");
  if (!texture && properties.element().legacy) texture = find_nested_texture(properties);
  scene::NormalMap map;
  map.nested = load_nested(properties, context);
  if (!texture) {
    context.problems.fail(
        "bsdf \"normalmap\" needs a texture: <texture name=\"normalmap\" type=\"bitmap\">",
        properties.element().where);
    return map;
  }
  map.normals = load_texture(*texture, context);
  return map;
}

}  // namespace metrofarm::scene_file::mitsuba
