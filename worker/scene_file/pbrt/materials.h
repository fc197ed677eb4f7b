// Materials, built when a shape first uses them.
#pragma once

#include <deque>
#include <map>
#include <string>
#include <utility>

#include "scene_file/pbrt/context.h"
#include "scene_file/pbrt/textures.h"

namespace metrofarm::scene_file::pbrt {

class Materials {
 public:
  // A material as shapes use it: what a Material or NamedMaterial directive stands for. 0 is pbrt's
  // default, diffuse with a reflectance of 0.5.
  using Use = int;

  Materials(Context& context, Textures& textures);

  Use use(Entity material);
  // The name may be defined later.
  Use use_named(std::string name, SourceLocation where);
  void define(const std::string& name, Entity material);

  // shape_uv: see Textures.
  scene::Index build(Use use, const UvMatrix& shape_uv);

  // `nested` made invisible in part: opacity is the "alpha" of a shape, a number or a texture.
  scene::Index build_mask(const Parameter& opacity, scene::Index nested, const UvMatrix& shape_uv);

 private:
  struct Named {
    std::string name;  // empty: `index` is valid
    size_t index = 0;
    SourceLocation where = {};
  };
  struct Request {
    Parameters& parameters;
    const std::string& type;
    const UvMatrix& shape_uv;
  };
  struct Roughness {
    scene::Scalar u, v;
    bool smooth = false;
  };

  scene::Index build(size_t index, const UvMatrix& shape_uv);
  scene::Index build_named(const std::string& name, const SourceLocation& where,
                           const UvMatrix& shape_uv);
  scene::Index build_entity(Entity& entity, const UvMatrix& shape_uv);
  scene::Index load_diffuse(const Request& request);
  scene::Index load_coated_diffuse(const Request& request);
  scene::Index load_conductor(const Request& request);
  scene::Index load_coated_conductor(const Request& request);
  scene::Index load_dielectric(const Request& request);
  scene::Index load_thin_dielectric(const Request& request);
  scene::Index load_diffuse_transmission(const Request& request);
  scene::Index load_interface(const Request& request);
  scene::Index load_mix(const Request& request);

  scene::Colour colour(const Request& request, std::string_view name, float fallback);
  scene::Scalar scalar(const Request& request, std::string_view name, float fallback);
  Roughness roughness(const Request& request, std::string_view prefix);
  scene::Index conductor(const Request& request, std::string_view prefix);
  float eta(const Request& request);
  scene::Index add(const Request& request, decltype(scene::Bsdf::model) model);
  scene::Index reflecting(const Request& request, decltype(scene::Bsdf::model) model);
  scene::Index with_relief(const Request& request, scene::Index nested);
  void refuse_inner_medium(const Request& request);

  Context& context_;
  Textures& textures_;
  std::deque<Entity> entities_;
  std::vector<Named> uses_;
  std::map<std::string, size_t> names_;
  std::map<std::pair<size_t, UvMatrix>, scene::Index> built_;
  std::vector<size_t> in_progress_;
};

}  // namespace metrofarm::scene_file::pbrt
