// PNG, BMP and TGA: stb_image decodes, and what it would decode wrongly or leave unnoticed is
// refused here first.
#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>

#include "image_io/formats.h"
#include "spectrum/srgb.h"
#define STBI_NO_STDIO
#include <stb/stb_image.h>

namespace metrofarm::image_io {
namespace {

constexpr const char* kEndsEarly = "the file ends early";

struct Size {
  int width = 0, height = 0, channels = 0;
};

// Frees as stb_image allocates.
struct Free {
  void operator()(void* pixels) const { stbi_image_free(pixels); }
};

// Of pairs of grey and alpha the alpha is left out.
int kept_channels(const Size& size) {
  return size.channels == 2 ? 1 : size.channels;
}

size_t pixel_count(const Size& size) {
  return static_cast<size_t>(size.width) * size.height;
}

scene::Image image_of_bytes(const stbi_uc* bytes, const Size& size, Encoding encoding) {
  const int channels = kept_channels(size);
  std::vector<uint8_t> pixels;
  if (channels == size.channels) {
    pixels.assign(bytes, bytes + pixel_count(size) * channels);
  } else {
    pixels.resize(pixel_count(size));
    for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = bytes[2 * i];
  }
  return {size.width, size.height, channels, std::move(pixels), encoding == Encoding::kSrgb};
}

scene::Image image_of_words(const stbi_us* words, const Size& size, Encoding encoding) {
  constexpr double kLargest = std::numeric_limits<stbi_us>::max();
  std::vector<float> decoded(static_cast<size_t>(kLargest) + 1);
  for (size_t i = 0; i < decoded.size(); ++i) {
    const double value = static_cast<double>(i) / kLargest;
    decoded[i] = static_cast<float>(encoding == Encoding::kSrgb ? srgb_to_linear(value) : value);
  }
  const int channels = kept_channels(size);
  std::vector<float> pixels(pixel_count(size) * channels);
  for (size_t i = 0; i < pixel_count(size); ++i)
    for (int c = 0; c < channels; ++c) {
      const stbi_us word = words[i * size.channels + c];
      pixels[i * channels + c] = c == 3 ? static_cast<float>(word / kLargest) : decoded[word];
    }
  return {size.width, size.height, channels, std::move(pixels)};
}

Result<scene::Image> decode(const Source& source, uint64_t most_pixels) {
  if (source.bytes.size() > static_cast<size_t>(std::numeric_limits<int>::max()))
    return Error{"the file is larger than 2 GiB"};
  const stbi_uc* data = source.bytes.data();
  const int length = static_cast<int>(source.bytes.size());
  Size size;
  if (stbi_info_from_memory(data, length, &size.width, &size.height, &size.channels) == 0)
    return Error{stbi_failure_reason()};
  const int64_t height = size.height;  // negative in a BMP whose rows run downwards
  const bool words = stbi_is_16_bit_from_memory(data, length) != 0;
  const uint64_t bytes_per_pixel = kept_channels(size) * (words ? sizeof(float) : 1);
  if (const auto error =
          check_claim(source, {size.width, std::abs(height), most_pixels, bytes_per_pixel}))
    return *error;
  if (words) {
    const std::unique_ptr<stbi_us, Free> pixels(
        stbi_load_16_from_memory(data, length, &size.width, &size.height, &size.channels, 0));
    if (!pixels) return Error{stbi_failure_reason()};
    return image_of_words(pixels.get(), size, source.encoding);
  }
  const std::unique_ptr<stbi_uc, Free> bytes(
      stbi_load_from_memory(data, length, &size.width, &size.height, &size.channels, 0));
  if (!bytes) return Error{stbi_failure_reason()};
  return image_of_bytes(bytes.get(), size, source.encoding);
}

uint32_t little_endian(std::span<const uint8_t> bytes, size_t at, int count) {
  uint32_t value = 0;
  for (int i = 0; i < count; ++i) value |= uint32_t{bytes[at + i]} << (8 * i);
  return value;
}

uint32_t big_endian_word(std::span<const uint8_t> bytes, size_t at) {
  return uint32_t{bytes[at]} << 8 | bytes[at + 1];
}

// Bytes of compressed pixels; nothing unless all chunks up to the end mark lie inside the file
// (PNG, section 5.3: length, type, data, checksum): stb_image takes memory for as much as they
// promise.
std::optional<uint64_t> png_data_bytes(std::span<const uint8_t> bytes) {
  constexpr size_t kAround = 12;
  uint64_t sum = 0;
  for (size_t at = 8; at + kAround <= bytes.size();) {
    const uint64_t length =
        uint64_t{big_endian_word(bytes, at)} << 16 | big_endian_word(bytes, at + 2);
    if (length + kAround > bytes.size() - at) return std::nullopt;
    if (std::memcmp(&bytes[at + 4], "IEND", 4) == 0) return sum;
    if (std::memcmp(&bytes[at + 4], "IDAT", 4) == 0) sum += length;
    at += kAround + length;
  }
  return std::nullopt;
}

// From the header, which is the first chunk; at least 1.
uint64_t png_pixel_bits(std::span<const uint8_t> bytes) {
  constexpr size_t kDepth = 24, kColourType = 25;
  if (bytes.size() <= kColourType) return 1;
  const uint8_t type = bytes[kColourType];
  const int samples = type == 2 ? 3 : type == 4 ? 2 : type == 6 ? 4 : 1;
  return uint64_t{std::max<uint8_t>(bytes[kDepth], 1)} * samples;
}

// Whether the run-length packets from `at` on make up `pixels` pixels (Truevision TGA 2.0, C.3).
bool has_packets(std::span<const uint8_t> bytes, size_t at, uint64_t pixels, int pixel_bytes) {
  while (pixels > 0) {
    if (at >= bytes.size()) return false;
    const bool run = (bytes[at] & 0x80) != 0;
    const uint64_t count = (bytes[at] & 0x7fU) + 1;
    at += 1 + pixel_bytes * (run ? 1 : count);
    pixels -= std::min(count, pixels);
  }
  return at <= bytes.size();
}

}  // namespace

Result<scene::Image> read_png(const Source& source) {
  const std::optional<uint64_t> data_bytes = png_data_bytes(source.bytes);
  if (!data_bytes) return Error{kEndsEarly};
  // Deflate packs at most 1032 : 1.
  return decode(source, *data_bytes * 1032 * 8 / png_pixel_bits(source.bytes));
}

Result<scene::Image> read_bmp(const Source& source) {
  const auto bytes = source.bytes;
  if (bytes.size() < 30) return Error{kEndsEarly};
  const bool os2 = little_endian(bytes, 14, 4) == 12;
  const int64_t width = os2 ? little_endian(bytes, 18, 2) : little_endian(bytes, 18, 4);
  const int64_t signed_height = os2 ? static_cast<int16_t>(little_endian(bytes, 20, 2))
                                    : static_cast<int32_t>(little_endian(bytes, 22, 4));
  const uint64_t pixel_bits = little_endian(bytes, os2 ? 24 : 28, 2);
  const int64_t height = signed_height < 0 ? -signed_height : signed_height;
  if (const auto error = check_claim(source, {width, height, bytes.size() * 8, 0})) return *error;
  const uint64_t row = (width * pixel_bits + 31) / 32 * 4;
  if (little_endian(bytes, 10, 4) + row * height > bytes.size()) return Error{kEndsEarly};
  return decode(source, bytes.size() * 8);
}

Result<scene::Image> read_tga(const Source& source) {
  const auto bytes = source.bytes;
  if ((bytes[17] & 0x10) != 0) return Error{"rows from right to left are not supported"};
  const int pixel_bytes = (bytes[16] + 7) / 8;
  const uint64_t map_bytes = uint64_t{little_endian(bytes, 5, 2)} * ((bytes[7] + 7) / 8);
  const size_t first = 18 + bytes[0] + (bytes[1] != 0 ? map_bytes : 0);
  const uint64_t pixels =
      uint64_t{little_endian(bytes, 12, 2)} * uint64_t{little_endian(bytes, 14, 2)};
  const bool run_lengths = (bytes[2] & 8) != 0;
  if (run_lengths ? !has_packets(bytes, first, pixels, pixel_bytes)
                  : first + pixels * pixel_bytes > bytes.size())
    return Error{kEndsEarly};
  return decode(source, bytes.size() * 64);  // a packet of 2 bytes makes at most 128 pixels
}

}  // namespace metrofarm::image_io
