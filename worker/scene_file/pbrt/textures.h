// Named textures, built when a material first asks for them.
#pragma once

#include <map>
#include <string>
#include <utility>

#include "scene_file/pbrt/context.h"

namespace metrofarm::scene_file::pbrt {

// Maps a shape's surface coordinates here to those that pbrt gives it, as a scene::UvMatrix.
using scene::UvMatrix;

class Textures {
 public:
  explicit Textures(Context& context) : context_(context) {}

  // A Texture directive. value_type: "float" or "spectrum"; names are known per type.
  void define(const std::string& name, const std::string& value_type, Entity entity);

  // The texture of that name and type as a colour: a constant, or a texture times a constant.
  // Problems are reported at `where`.
  scene::Colour find(const std::string& name, bool is_spectrum, const UvMatrix& shape_uv,
                     const SourceLocation& where);

  // Index of the image in the file `name`, which is read once; kNone after a problem.
  scene::Index image(const std::string& name, bool linear, const SourceLocation& where);

 private:
  struct Definition {
    Entity entity;
    bool is_spectrum = true;
    bool in_progress = false;
    std::map<UvMatrix, scene::Colour> built = {};
  };
  struct Request {
    const std::string& name;
    Definition& definition;
    const UvMatrix& shape_uv;
  };

  scene::Colour build(const Request& request);
  scene::Colour build_constant(const Request& request);
  scene::Colour build_scale(const Request& request);
  scene::Colour build_mix(const Request& request);
  scene::Colour build_imagemap(const Request& request);
  scene::Colour build_checkerboard(const Request& request);
  scene::Colour operand(const Request& request, std::string_view name, float fallback);
  scene::Index image_of(const Request& request, Parameters& parameters);
  UvMatrix read_mapping(const Request& request);

  Context& context_;
  int depth_ = 0;  // of textures inside textures
  std::map<std::pair<std::string, bool>, Definition> definitions_;
  std::map<std::pair<std::string, bool>, scene::Index> images_;  // by file and linearity
};

// outer after inner.
UvMatrix compose(const UvMatrix& outer, const UvMatrix& inner);

}  // namespace metrofarm::scene_file::pbrt
