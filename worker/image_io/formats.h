// One reader per family of image formats, behind read_image.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/result.h"
#include "image_io/read_image.h"
#include "scene/description.h"

namespace metrofarm::image_io {

// A file in memory and what its reader must know. Errors leave here without location.
struct Source {
  std::span<const uint8_t> bytes;
  Encoding encoding = Encoding::kSrgb;
  uint64_t max_bytes = 0;  // of decoded pixels
};

// What a header promises.
struct Claim {
  int64_t width = 0, height = 0;
  uint64_t most_pixels = 0;      // that the bytes of the file can stand for
  uint64_t bytes_per_pixel = 0;  // of memory
};

// Refuses sizes that are not positive, larger than allowed, or more than the file can hold.
std::optional<Error> check_claim(const Source& source, const Claim& claim);

Result<scene::Image> read_png(const Source& source);
Result<scene::Image> read_jpeg(const Source& source);
Result<scene::Image> read_bmp(const Source& source);
Result<scene::Image> read_tga(const Source& source);
Result<scene::Image> read_hdr(const Source& source);
Result<scene::Image> read_pfm(const Source& source);
Result<scene::Image> read_exr(const Source& source);

}  // namespace metrofarm::image_io
