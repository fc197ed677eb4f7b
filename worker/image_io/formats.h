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
  uint64_t max_pixels = kMaxPixels;
};

// Refuses sizes that are not positive, larger than allowed, or more than the file can hold if a
// byte of it stands for at most pixels_per_byte pixels: what is allocated then stays in proportion
// to the file.
std::optional<Error> check_size(const Source& source, int64_t width, int64_t height,
                                uint64_t pixels_per_byte);

Result<scene::Image> read_png(const Source& source);
Result<scene::Image> read_jpeg(const Source& source);
Result<scene::Image> read_bmp(const Source& source);
Result<scene::Image> read_tga(const Source& source);
Result<scene::Image> read_hdr(const Source& source);
Result<scene::Image> read_pfm(const Source& source);
Result<scene::Image> read_exr(const Source& source);

}  // namespace metrofarm::image_io
