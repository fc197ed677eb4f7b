#include "scene_file/pbrt/materials.h"

#include <algorithm>

#include "scene_file/names.h"

namespace metrofarm::scene_file::pbrt {

using scene::Index;

Materials::Materials(Context& context, Textures& textures)
    : context_(context), textures_(textures) {
  use({"diffuse", {}});
}

Materials::Use Materials::use(Entity material) {
  entities_.push_back(std::move(material));
  uses_.push_back({"", entities_.size() - 1});
  return static_cast<Use>(uses_.size() - 1);
}

Materials::Use Materials::use_named(std::string name, SourceLocation where) {
  uses_.push_back({std::move(name), 0, std::move(where)});
  return static_cast<Use>(uses_.size() - 1);
}

void Materials::define(const std::string& name, Entity material) {
  const auto [found, is_new] = names_.emplace(name, entities_.size());
  if (!is_new) {
    return context_.problems.fail("material \"" + name + "\" is already defined in line " +
                                      std::to_string(entities_[found->second].where().line) +
                                      "; names must be unique",
                                  material.where());
  }
  entities_.push_back(std::move(material));
}

Index Materials::build(Use use, const UvMatrix& shape_uv) {
  const Named& named = uses_[static_cast<size_t>(use)];
  if (named.name.empty()) return build(named.index, shape_uv);
  return build_named(named.name, named.where, shape_uv);
}

Index Materials::build_named(const std::string& name, const SourceLocation& where,
                             const UvMatrix& shape_uv) {
  const auto found = names_.find(name);
  if (found != names_.end()) return build(found->second, shape_uv);
  std::vector<std::string_view> known;
  for (const auto& [other, unused] : names_) known.push_back(other);
  context_.problems.fail("no material is named \"" + name + "\"" + suggestion(name, known), where);
  return 0;
}

Index Materials::build(size_t index, const UvMatrix& shape_uv) {
  const auto found = built_.find({index, shape_uv});
  if (found != built_.end()) return found->second;
  Entity& entity = entities_[index];
  if (std::find(in_progress_.begin(), in_progress_.end(), index) != in_progress_.end()) {
    context_.problems.fail("this material mixes itself", entity.where());
    return 0;
  }
  constexpr size_t kMaxNesting = 64;
  if (in_progress_.size() >= kMaxNesting) {
    context_.problems.fail(
        "materials are nested more than " + std::to_string(kMaxNesting) + " deep", entity.where());
    return 0;
  }
  in_progress_.push_back(index);
  const Index bsdf = build_entity(entity, shape_uv);
  in_progress_.pop_back();
  built_.emplace(std::make_pair(index, shape_uv), bsdf);
  return bsdf;
}

Index Materials::build_entity(Entity& entity, const UvMatrix& shape_uv) {
  struct Row {
    std::string_view type;
    Index (Materials::*load)(const Request&);
  };
  static constexpr Row kRows[] = {
      {"diffuse", &Materials::load_diffuse},
      {"coateddiffuse", &Materials::load_coated_diffuse},
      {"conductor", &Materials::load_conductor},
      {"coatedconductor", &Materials::load_coated_conductor},
      {"dielectric", &Materials::load_dielectric},
      {"thindielectric", &Materials::load_thin_dielectric},
      {"diffusetransmission", &Materials::load_diffuse_transmission},
      {"interface", &Materials::load_interface},
      {"mix", &Materials::load_mix},
  };
  const Request request{entity.parameters, entity.type, shape_uv};
  std::vector<std::string_view> supported;
  for (const Row& row : kRows) {
    supported.push_back(row.type);
    if (row.type != entity.type) continue;
    const Index bsdf = (this->*row.load)(request);
    entity.parameters.finish("material \"" + entity.type + "\"", context_.problems);
    return bsdf;
  }
  report_unknown_plugin("material", entity, supported, "a grey diffuse one takes its place",
                        context_.problems);
  return reflecting(request, scene::Diffuse{});
}

Index Materials::build_mask(const Parameter& opacity, Index nested, const UvMatrix& shape_uv) {
  scene::Mask mask;
  mask.nested = nested;
  if (opacity.type == ParameterType::kFloat && opacity.numbers.size() == 1) {
    mask.opacity = {static_cast<float>(opacity.numbers[0])};
  } else if (opacity.type == ParameterType::kTexture && opacity.strings.size() == 1) {
    const scene::Colour colour = textures_.find(opacity.strings[0], false, shape_uv, opacity.where);
    mask.opacity = {colour.value[0], colour.texture};
  } else {
    context_.problems.fail("\"alpha\" must be one number or the name of one texture",
                           opacity.where);
  }
  if (mask.opacity.texture == scene::kNone && mask.opacity.value >= 1) return nested;
  return append(context_.scene.bsdfs, {mask, "", opacity.where});
}

}  // namespace metrofarm::scene_file::pbrt
