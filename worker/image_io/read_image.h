// Image files as pixels: PNG, JPEG, BMP, TGA, Radiance HDR, PFM and OpenEXR, told apart by their
// content.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "base/result.h"
#include "scene/description.h"

namespace metrofarm::image_io {

// How integer pixels are to be understood. Files in floating point are always linear.
enum class Encoding { kSrgb, kLinear };

inline constexpr uint64_t kMaxPixels = uint64_t{1} << 28;
// Of an image file whose decoding nobody limits further: decode_limit() alone holds.
inline constexpr uint64_t kAnyBytes = std::numeric_limits<uint64_t>::max();

// name: the file, for messages. Grey stays one channel (a grey file's alpha is dropped), palettes
// become RGB. 8 bits stay bytes; 16 bits and floating point become floats, linear in either
// encoding. OpenEXR gives the data window and its R, G, B and A or Y, in Rec. 709 primaries.
// Pixels that take more than max_bytes or decode_limit() of the file's size, or that the file is
// too short for, are refused by the header, before memory is taken. Errors name the format and what
// is wrong with the file.
Result<scene::Image> read_image(std::span<const uint8_t> bytes, std::string_view name,
                                Encoding encoding, uint64_t max_bytes = kAnyBytes);

}  // namespace metrofarm::image_io
