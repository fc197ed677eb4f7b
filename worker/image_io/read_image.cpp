#include "image_io/read_image.h"

#include <algorithm>
#include <array>

#include "base/decode_limit.h"
#include "image_io/formats.h"

namespace metrofarm::image_io {
namespace {

struct Format {
  const char* name;
  std::string_view magic;
  Result<scene::Image> (*read)(const Source&);
};

using namespace std::string_view_literals;

constexpr std::array kFormats = {
    Format{"PNG", "\x89PNG\r\n\x1a\n"sv, read_png},
    Format{"JPEG", "\xff\xd8\xff"sv, read_jpeg},
    Format{"OpenEXR", "\x76\x2f\x31\x01"sv, read_exr},
    Format{"Radiance HDR", "#?RADIANCE"sv, read_hdr},
    Format{"Radiance HDR", "#?RGBE"sv, read_hdr},
    Format{"PFM", "PF\n"sv, read_pfm},
    Format{"PFM", "Pf\n"sv, read_pfm},
    Format{"BMP", "BM"sv, read_bmp},
};

// TGA has no magic number: what its header says of colour maps and types must fit together.
bool looks_like_tga(std::span<const uint8_t> bytes) {
  if (bytes.size() < 18) return false;
  const int colour_map = bytes[1], type = bytes[2] & ~8, bits = bytes[16];
  if (bytes[2] > 11 || colour_map > 1 || type < 1 || type > 3) return false;
  if ((type == 1) != (colour_map == 1)) return false;
  return bits == 8 || bits == 15 || bits == 16 || bits == 24 || bits == 32;
}

const Format* format_of(std::span<const uint8_t> bytes) {
  static constexpr Format kTga = {"TGA", "", read_tga};
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  for (const Format& format : kFormats)
    if (text.starts_with(format.magic)) return &format;
  return looks_like_tga(bytes) ? &kTga : nullptr;
}

}  // namespace

std::optional<Error> check_claim(const Source& source, const Claim& claim) {
  const auto [width, height, most_pixels, bytes_per_pixel] = claim;
  const std::string size = std::to_string(width) + " x " + std::to_string(height) + " pixels";
  constexpr int64_t kMaxSide = int64_t{1} << 22;  // tables over a side have steps of 2^-24
  if (width < 1 || height < 1) return Error{"an image of " + size};
  if (width > kMaxSide || height > kMaxSide)
    return Error{size + "; the longest side allowed has " + std::to_string(kMaxSide)};
  const uint64_t pixels = static_cast<uint64_t>(width) * static_cast<uint64_t>(height);
  if (pixels > kMaxPixels)
    return Error{size + "; at most " + std::to_string(kMaxPixels) + " are allowed"};
  if (pixels > most_pixels)
    return Error{"the header promises " + size + ", more than the file's " +
                 std::to_string(source.bytes.size()) + " bytes can hold"};
  if (pixels * bytes_per_pixel > source.max_bytes)
    return Error{size + " take " + std::to_string(pixels * bytes_per_pixel) +
                 " bytes of memory; of a file of " + std::to_string(source.bytes.size()) +
                 " bytes at most " + std::to_string(source.max_bytes) + " are allowed"};
  return std::nullopt;
}

Result<scene::Image> read_image(std::span<const uint8_t> bytes, std::string_view name,
                                Encoding encoding, uint64_t max_bytes) {
  const SourceLocation where{std::string(name), 0};
  if (bytes.empty()) return Error{"the image file is empty", where};
  const Format* format = format_of(bytes);
  if (format == nullptr)
    return Error{"unknown image format; PNG, JPEG, OpenEXR, HDR, PFM, BMP and TGA can be read",
                 where};
  Result<scene::Image> image =
      format->read({bytes, encoding, std::min(max_bytes, decode_limit(bytes.size()))});
  if (!image) return Error{std::string(format->name) + " image: " + image.error().message, where};
  return image;
}

}  // namespace metrofarm::image_io
