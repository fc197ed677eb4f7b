// The layout is that of "OpenEXR File Layout": after magic number and version come attributes, each
// a name, a type, a size and a value. An empty name ends a header, an empty header those of a file
// in parts.
#include "image_io/exr_header.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <string_view>

namespace metrofarm::image_io {
namespace {

struct FixedSize {
  std::string_view type;
  size_t bytes;
};

constexpr std::array kFixedSizes = std::to_array<FixedSize>({
    {"box2i", 16},      {"box2f", 16},   {"chromaticities", 32},
    {"compression", 1}, {"double", 8},   {"envmap", 1},
    {"float", 4},       {"int", 4},      {"keycode", 28},
    {"lineOrder", 1},   {"m33f", 36},    {"m33d", 72},
    {"m44f", 64},       {"m44d", 128},   {"rational", 8},
    {"tiledesc", 9},    {"timecode", 8}, {"v2i", 8},
    {"v2f", 8},         {"v2d", 16},     {"v3i", 12},
    {"v3f", 12},        {"v3d", 24},     {"deepImageState", 1},
});

class Reader {
 public:
  explicit Reader(std::span<const uint8_t> bytes) : bytes_(bytes) {}

  // Up to the next zero, which is skipped.
  std::optional<std::string_view> string() {
    const auto zero = std::find(bytes_.begin(), bytes_.end(), uint8_t{0});
    if (zero == bytes_.end()) return std::nullopt;
    const std::string_view text(reinterpret_cast<const char*>(bytes_.data()),
                                zero - bytes_.begin());
    bytes_ = bytes_.subspan(text.size() + 1);
    return text;
  }
  std::optional<uint32_t> word() {
    uint32_t value = 0;
    const auto bytes = take(sizeof value);
    if (!bytes) return std::nullopt;
    std::memcpy(&value, bytes->data(), sizeof value);
    return value;
  }
  std::optional<std::span<const uint8_t>> take(size_t count) {
    if (count > bytes_.size()) return std::nullopt;
    const auto taken = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return taken;
  }
  bool at_end() const { return bytes_.empty(); }

 private:
  std::span<const uint8_t> bytes_;
};

// Names with 16 bytes each, then a zero.
bool is_channel_list(std::span<const uint8_t> value) {
  Reader reader(value);
  for (;;) {
    const auto name = reader.string();
    if (!name) return false;
    if (name->empty()) return reader.at_end();
    if (!reader.take(16)) return false;
  }
}

bool is_preview(std::span<const uint8_t> value) {
  Reader reader(value);
  const auto width = reader.word(), height = reader.word();
  return width && height && (value.size() - 8) % 4 == 0 &&
         uint64_t{*width} * *height == (value.size() - 8) / 4;
}

bool has_size_of_type(std::string_view type, std::span<const uint8_t> value) {
  if (type == "chlist") return is_channel_list(value);
  if (type == "preview") return is_preview(value);
  const auto found = std::find_if(kFixedSizes.begin(), kFixedSizes.end(),
                                  [&](const FixedSize& fixed) { return fixed.type == type; });
  return found == kFixedSizes.end() || found->bytes == value.size();
}

}  // namespace

bool exr_attributes_fit(std::span<const uint8_t> bytes) {
  Reader reader(bytes);
  reader.word();  // magic number
  const auto version = reader.word();
  if (!version) return false;
  const bool in_parts = (*version & 0x1000) != 0;
  for (int count = 0;;) {
    const auto name = reader.string();
    if (!name) return false;
    if (name->empty()) {
      if (!in_parts || count == 0) return true;
      count = 0;
      continue;
    }
    ++count;
    const auto type = reader.string();
    const auto size = type ? reader.word() : std::nullopt;
    const auto value = size ? reader.take(*size) : std::nullopt;
    if (!value || !has_size_of_type(*type, *value)) return false;
  }
}

}  // namespace metrofarm::image_io
