// The textures of a scene, evaluated at eight surface points at once.
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "scene/description.h"
#include "spectrum/rgb.h"
#include "texture/images.h"

namespace metrofarm::texture {

// Change of a texture's luminance along the surface coordinates.
struct Gradient {
  Float du, dv;
};

// Immutable; thread-safe.
class Textures {
 public:
  // images and primitives: outlive this.
  Textures(const std::vector<scene::Texture>& textures, const Images& images,
           const geometry::Primitives& primitives);

  // `texture` indexes the description's textures and is valid in all of `lanes`; other lanes are 0.
  Spectrum colour(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  Float luminance(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  Gradient gradient(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;

  uint64_t bytes() const;
};

}  // namespace metrofarm::texture
