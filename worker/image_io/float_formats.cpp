// Radiance HDR and PFM.
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>

#include "image_io/formats.h"

namespace metrofarm::image_io {
namespace {

// Reads a file from its start, by lines and bytes.
class Cursor {
 public:
  explicit Cursor(std::span<const uint8_t> bytes) : bytes_(bytes) {}

  // The next line without its end; nothing at the end of the file.
  std::optional<std::string_view> line() {
    const auto begin = bytes_.begin() + at_;
    const auto end = std::find(begin, bytes_.end(), uint8_t{'\n'});
    if (end == bytes_.end()) return std::nullopt;
    const std::string_view text(reinterpret_cast<const char*>(bytes_.data()) + at_, end - begin);
    at_ += text.size() + 1;
    return text.ends_with('\r') ? text.substr(0, text.size() - 1) : text;
  }

  std::span<const uint8_t> rest() const { return bytes_.subspan(at_); }
  void skip(size_t count) { at_ += count; }

 private:
  std::span<const uint8_t> bytes_;
  size_t at_ = 0;
};

// The words of a line, separated by single blanks.
template <size_t Count>
std::optional<std::array<std::string_view, Count>> words_of(std::string_view line) {
  std::array<std::string_view, Count> words;
  for (size_t i = 0; i < Count; ++i) {
    const size_t end = std::min(line.find(' '), line.size());
    if (end == 0 || (i + 1 == Count && end != line.size())) return std::nullopt;
    words[i] = line.substr(0, end);
    line.remove_prefix(std::min(end + 1, line.size()));
  }
  return words;
}

template <class T>
std::optional<T> number(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

struct Size {
  int width = 0, height = 0;
};

// ---- Radiance HDR (G. Ward, "Real Pixels", Graphics Gems II, 1991, and the file formats of
// Radiance) ----

constexpr const char* kEndsEarly = "the file ends early";

using Rgbe = std::array<uint8_t, 4>;

Result<Size> read_hdr_header(Cursor& cursor) {
  for (auto line = cursor.line(); !line || !line->empty(); line = cursor.line()) {
    if (!line) return Error{"the header has no end"};
    if (line->starts_with("FORMAT=") && *line != "FORMAT=32-bit_rle_rgbe")
      return Error{"pixels in " + std::string(line->substr(7)) +
                   " are not supported, only 32-bit_rle_rgbe"};
  }
  const auto line = cursor.line();
  if (!line) return Error{kEndsEarly};
  const auto words = words_of<4>(*line);
  if (!words || (*words)[0] != "-Y" || (*words)[2] != "+X")
    return Error{"the size must read \"-Y height +X width\"; other orders are not supported"};
  const auto height = number<int>((*words)[1]), width = number<int>((*words)[3]);
  if (!height || !width) return Error{"the size must be whole numbers"};
  return Size{*width, *height};
}

// A scanline whose four components are packed one after the other.
bool read_packed_components(Cursor& cursor, std::span<Rgbe> row) {
  for (int component = 0; component < 4; ++component) {
    for (size_t x = 0; x < row.size();) {
      const auto in = cursor.rest();
      if (in.size() < 2) return false;
      const bool run = in[0] > 128;
      const size_t count = run ? in[0] - 128 : in[0];
      const size_t stored = run ? 1 : count;
      if (count == 0 || count > row.size() - x || in.size() < 1 + stored) return false;
      for (size_t i = 0; i < count; ++i) row[x++][component] = in[run ? 1 : 1 + i];
      cursor.skip(1 + stored);
    }
  }
  return true;
}

// Pixels one by one; (1, 1, 1, n) repeats the one before n times, and directly after another such
// mark n * 256 times.
bool read_plain_pixels(Cursor& cursor, std::span<Rgbe> row) {
  int shift = 0;
  for (size_t x = 0; x < row.size();) {
    const auto in = cursor.rest();
    if (in.size() < 4) return false;
    const Rgbe pixel = {in[0], in[1], in[2], in[3]};
    cursor.skip(4);
    if (pixel[0] == 1 && pixel[1] == 1 && pixel[2] == 1) {
      const size_t count = shift < 24 ? size_t{pixel[3]} << shift : row.size();
      if (x == 0 || count > row.size() - x) return false;
      std::fill_n(row.begin() + x, count, row[x - 1]);
      x += count;
      shift += 8;
    } else {
      row[x++] = pixel;
      shift = 0;
    }
  }
  return true;
}

bool read_scanline(Cursor& cursor, std::span<Rgbe> row) {
  const auto in = cursor.rest();
  const bool packed = row.size() >= 8 && row.size() < 32768 && in.size() >= 4 && in[0] == 2 &&
                      in[1] == 2 && (size_t{in[2]} << 8 | in[3]) == row.size();
  if (!packed) return read_plain_pixels(cursor, row);
  cursor.skip(4);
  return read_packed_components(cursor, row);
}

void append_pixels(std::span<const Rgbe> row, std::vector<float>& pixels) {
  for (const Rgbe& pixel : row) {
    const float scale = pixel[3] == 0 ? 0.F : std::ldexp(1.F, pixel[3] - (128 + 8));
    for (int channel = 0; channel < 3; ++channel)
      pixels.push_back(static_cast<float>(pixel[channel]) * scale);
  }
}

// ---- PFM ----

Result<Size> read_pfm_size(Cursor& cursor) {
  const auto line = cursor.line();
  if (!line) return Error{kEndsEarly};
  const auto words = words_of<2>(*line);
  if (!words) return Error{"the second line must read \"width height\""};
  const auto width = number<int>((*words)[0]), height = number<int>((*words)[1]);
  if (!width || !height) return Error{"the second line must read \"width height\""};
  return Size{*width, *height};
}

float read_float(const uint8_t* bytes, bool little_endian) {
  uint32_t word = 0;
  for (int i = 0; i < 4; ++i) word |= uint32_t{bytes[i]} << (8 * (little_endian ? i : 3 - i));
  return std::bit_cast<float>(word);
}

}  // namespace

Result<scene::Image> read_hdr(const Source& source) {
  Cursor cursor(source.bytes);
  const Result<Size> size = read_hdr_header(cursor);
  if (!size) return size.error();
  const auto [width, height] = size.value();
  // Two repeats in a row of old run lengths stand for 65536 pixels.
  const Claim claim = {width, height, source.bytes.size() * 65536, 3 * sizeof(float)};
  if (const auto error = check_claim(source, claim)) return *error;
  std::vector<Rgbe> row(width);
  Cursor ahead = cursor;  // a file that ends early takes no memory
  for (int y = 0; y < height; ++y)
    if (!read_scanline(ahead, row))
      return Error{"row " + std::to_string(y) + " is damaged, or the file ends early"};
  std::vector<float> pixels;
  pixels.reserve(size_t{3} * width * height);
  for (int y = 0; y < height; ++y) {
    read_scanline(cursor, row);
    append_pixels(row, pixels);
  }
  return scene::Image{width, height, 3, std::move(pixels)};
}

Result<scene::Image> read_pfm(const Source& source) {
  Cursor cursor(source.bytes);
  const int channels = *cursor.line() == "PF" ? 3 : 1;
  const Result<Size> size = read_pfm_size(cursor);
  if (!size) return size.error();
  const auto [width, height] = size.value();
  const auto scale_line = cursor.line();
  const auto scale = scale_line ? number<double>(*scale_line) : std::nullopt;
  if (!scale || *scale == 0) return Error{"the third line must be a number other than 0"};
  const Claim claim = {width, height, source.bytes.size(), sizeof(float) * channels};
  if (const auto error = check_claim(source, claim)) return *error;
  const size_t row = static_cast<size_t>(width) * channels;
  const auto data = cursor.rest();
  if (data.size() / 4 / row < static_cast<size_t>(height)) return Error{kEndsEarly};
  std::vector<float> pixels(row * height);
  for (int y = 0; y < height; ++y)  // the file's first row is the lowest one
    for (size_t i = 0; i < row; ++i)
      pixels[(height - 1 - y) * row + i] = read_float(&data[4 * (y * row + i)], *scale < 0);
  return scene::Image{width, height, channels, std::move(pixels)};
}

}  // namespace metrofarm::image_io
