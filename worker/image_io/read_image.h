// Image files as pixels: PNG, JPEG, BMP, TGA, HDR and OpenEXR, told apart by their content.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/result.h"
#include "scene/description.h"

namespace metrofarm::image_io {

// How integer pixels are to be understood. Files in floating point are always linear.
enum class Encoding { kSrgb, kLinear };

// name: the file, for messages. Grey stays one channel, palettes become RGB. Errors name the format
// and what is wrong with the file.
Result<scene::Image> read_image(std::span<const uint8_t> bytes, std::string_view name,
                                Encoding encoding);

}  // namespace metrofarm::image_io
