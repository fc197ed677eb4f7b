// The pixels of all images of a scene, for textures and environment maps.
#pragma once

#include <cstddef>
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
  Images(Images&&) = default;
  Images& operator=(Images&&) = default;

  int width(scene::Index image) const;
  int height(scene::Index image) const;

  // Linear RGB of pixels (x, y), row 0 at the top. Requires: x and y inside each lane's image.
  Spectrum pixel(Int image, Int x, Int y, Mask lanes) const;
  // The same of one pixel, for tables made at load.
  scene::Rgb pixel(scene::Index image, int x, int y) const;

  uint64_t bytes() const;

 private:
  // Where one image's pixels lie and what they mean. Exactly one of `bytes` and `floats` is set.
  struct Record {
    const uint8_t* bytes = nullptr;
    const float* floats = nullptr;
    const float* decode = nullptr;  // of the 256 byte values
    size_t row = 0;                 // values per row
    int channels = 1;
    int green = 0, blue = 0;  // channels after the first one that hold them; 0 in grey images

    scene::Rgb at(int x, int y) const;
  };

  std::vector<scene::Image> images_;
  std::vector<float> decode_;
  std::vector<Record> records_;
};

}  // namespace metrofarm::texture
