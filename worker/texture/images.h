// The pixels of all images of a scene, for textures and environment maps.
#pragma once

#include <cstdint>
#include <vector>

#include "math/lanes.h"
#include "scene/description.h"
#include "spectrum/rgb.h"

namespace metrofarm::texture {

// Immutable; thread-safe.
class Images {
 public:
  // Pixels are moved, not copied.
  explicit Images(std::vector<scene::Image>&& images);

  int width(scene::Index image) const;
  int height(scene::Index image) const;

  // Linear RGB of pixels (x, y), row 0 at the top. Requires: x and y inside each lane's image.
  Spectrum pixel(Int image, Int x, Int y, Mask lanes) const;
  // The same of one pixel, for tables made at load.
  scene::Rgb pixel(scene::Index image, int x, int y) const;

  uint64_t bytes() const;
};

}  // namespace metrofarm::texture
