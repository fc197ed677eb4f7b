// The textures of a scene, evaluated at eight surface points at once.
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "scene/description.h"
#include "spectrum/rgb.h"

namespace metrofarm::texture {

// Change of a texture's luminance along the surface coordinates.
struct Gradient {
  Float du, dv;
};

// Immutable; thread-safe.
class Textures {
 public:
  // Images are moved out of the description; it must outlive nothing.
  Textures(scene::SceneDescription& description, const geometry::Primitives& primitives);

  // `texture` indexes the description's textures and is valid in all of `lanes`; other lanes are 0.
  Spectrum colour(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  Float luminance(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  Gradient gradient(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;

  uint64_t bytes() const;
};

}  // namespace metrofarm::texture
