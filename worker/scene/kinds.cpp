#include "scene/kinds.h"

namespace metrofarm::scene {
namespace {

// One name per alternative of a variant, in its order.
template <class Variant, size_t count>
const char* name_of(const Variant& model, const char* const (&names)[count]) {
  static_assert(std::variant_size_v<Variant> == count);
  return names[model.index()];
}

}  // namespace

const char* kind_of(const Shape& shape) {
  static constexpr const char* kNames[] = {"mesh", "sphere", "disk", "cylinder"};
  return name_of(shape.geometry, kNames);
}

const char* kind_of(const Texture& texture) {
  static constexpr const char* kNames[] = {"bitmap", "checkerboard", "mesh_attribute"};
  return name_of(texture.model, kNames);
}

const char* kind_of(const Bsdf& bsdf) {
  static constexpr const char* kNames[] = {
      "diffuse",        "conductor",       "roughconductor", "dielectric",   "twosided",
      "thindielectric", "roughdielectric", "plastic",        "roughplastic", "phong",
      "principled",     "principledthin",  "difftrans",      "null",         "mask",
      "blendbsdf",      "bumpmap",         "normalmap"};
  return name_of(bsdf.model, kNames);
}

const char* kind_of(const Emitter& emitter) {
  static constexpr const char* kNames[] = {"area",        "point",  "constant", "spot",
                                           "directional", "envmap", "projector"};
  return name_of(emitter.model, kNames);
}

const char* kind_of(Projection projection) {
  switch (projection) {
    case Projection::kPerspective:
      return "perspective";
    case Projection::kThinLens:
      return "thinlens";
    case Projection::kOrthographic:
      return "orthographic";
  }
  return "";
}

}  // namespace metrofarm::scene
