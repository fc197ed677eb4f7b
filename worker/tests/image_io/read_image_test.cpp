// One picture in many formats (make_files.py), and files that must be refused.
#include "image_io/read_image.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>

#include "spectrum/srgb.h"
#include "tests/image_io/files.h"

namespace metrofarm::image_io::test {
namespace {

using Value = std::function<double(int x, int y, int c)>;

double byte_at(int x, int y, int c) {
  return 40 * x + 20 * y + 7 * c;
}
double number_at(int x, int y, int c) {
  return x * 0.5 + y * 4 + c * 0.125;
}

scene::Image read_valid(const std::string& name, Encoding encoding = Encoding::kSrgb) {
  auto image = read_image(read_file(name), name, encoding);
  EXPECT_TRUE(image.ok()) << (image.ok() ? "" : image.error().to_string());
  return image.ok() ? std::move(image.value()) : scene::Image{};
}

double value_at(const scene::Image& image, int x, int y, int c) {
  const size_t i = (static_cast<size_t>(y) * image.width + x) * image.channels + c;
  return std::visit([i](const auto& p) { return static_cast<double>(p.at(i)); }, image.pixels);
}

void expect_picture(const scene::Image& image, int channels, const Value& value, double tolerance) {
  ASSERT_EQ(image.height, 4);
  ASSERT_EQ(image.channels, channels);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < channels; ++c)
        EXPECT_NEAR(value_at(image, x, y, c), value(x, y, c), tolerance) << x << ' ' << y;
}

bool has_bytes(const scene::Image& image) {
  return std::holds_alternative<std::vector<uint8_t>>(image.pixels);
}

TEST(ReadImage, BytesStayBytes) {
  const std::vector<std::pair<std::string, int>> files = {
      {"grey8.png", 1},    {"rgb8.png", 3},     {"grey_alpha8.png", 1}, {"rgba8.png", 4},
      {"palette8.png", 3}, {"rgb.bmp", 3},      {"top_down.bmp", 3},    {"palette.bmp", 3},
      {"rgb.tga", 3},      {"rgba_rle.tga", 4}, {"grey.tga", 1}};
  for (const auto& [name, channels] : files) {
    SCOPED_TRACE(name);
    const scene::Image image = read_valid(name);
    EXPECT_EQ(image.width, 5);
    EXPECT_TRUE(has_bytes(image) && image.srgb);
    expect_picture(image, channels, byte_at, 0);
    EXPECT_FALSE(read_valid(name, Encoding::kLinear).srgb);
  }
}

TEST(ReadImage, SingleBitsBecomeBytes) {
  expect_picture(
      read_valid("grey1.png"), 1,
      [](int x, int y, int) { return (0xa0 >> (y % 2) << x & 0x80) != 0 ? 255 : 0; }, 0);
}

TEST(ReadImage, JpegWithinItsLoss) {
  expect_picture(read_valid("rgb.jpg"), 3, byte_at, 2);
  expect_picture(read_valid("grey.jpg"), 1, byte_at, 1);
}

TEST(ReadImage, SixteenBitsBecomeLinearFloats) {
  const std::vector<std::pair<std::string, int>> files = {
      {"grey16.png", 1}, {"rgb16.png", 3}, {"grey_alpha16.png", 1}, {"rgba16.png", 4}};
  for (const auto& [name, channels] : files) {
    SCOPED_TRACE(name);
    const auto stored = [](int x, int y, int c) { return (257 * byte_at(x, y, c) + 1) / 65535; };
    const scene::Image linear = read_valid(name, Encoding::kLinear);
    EXPECT_FALSE(has_bytes(linear) || linear.srgb);
    expect_picture(linear, channels, stored, 1e-7);
    const auto decoded = [&](int x, int y, int c) {
      return c == 3 ? stored(x, y, c) : srgb_to_linear(stored(x, y, c));
    };
    const scene::Image srgb = read_valid(name, Encoding::kSrgb);
    EXPECT_FALSE(srgb.srgb);
    expect_picture(srgb, channels, decoded, 1e-7);
  }
}

TEST(ReadImage, HdrInItsThreePackings) {
  const auto sixteenth = [](int x, int y, int c) { return byte_at(x % 5, y, c) / 16; };
  expect_picture(read_valid("flat.hdr"), 3, sixteenth, 0);
  const scene::Image packed = read_valid("packed.hdr");
  EXPECT_EQ(packed.width, 10);
  expect_picture(packed, 3, sixteenth, 0);
  expect_picture(
      read_valid("repeats.hdr"), 3, [&](int, int y, int c) { return sixteenth(0, y, c); }, 0);
}

TEST(ReadImage, FloatingPoint) {
  const std::vector<std::pair<std::string, int>> files = {
      {"half.exr", 3},       {"float_alpha.exr", 4}, {"grey.exr", 1}, {"tiled.exr", 3},
      {"compressed.exr", 3}, {"rgb.pfm", 3},         {"grey.pfm", 1}};
  for (const auto& [name, channels] : files) {
    SCOPED_TRACE(name);
    const scene::Image image = read_valid(name);
    EXPECT_EQ(image.width, 5);
    EXPECT_FALSE(has_bytes(image) || image.srgb);
    expect_picture(image, channels, number_at, 0);
  }
  expect_picture(read_valid("uint.exr"), 3, byte_at, 0);
}

// X, Y and Z as primaries: the file holds XYZ, so that Rec. 709 needs the matrix of that standard.
TEST(ReadImage, ExrPrimariesBecomeRec709) {
  const double matrix[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                               {-0.9692660, 1.8760108, 0.0415560},
                               {0.0556434, -0.2040259, 1.0572252}};
  const auto rec709 = [&](int x, int y, int c) {
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += matrix[c][k] * number_at(x, y, k);
    return sum;
  };
  expect_picture(read_valid("primaries.exr"), 3, rec709, 0.01);
}

std::string error_of(std::span<const uint8_t> bytes, uint64_t max_bytes = kAnyBytes) {
  const auto image = read_image(bytes, "picture", Encoding::kSrgb, max_bytes);
  return image.ok() ? "" : image.error().to_string();
}

TEST(ReadImage, ErrorsNameFileFormatAndReason) {
  EXPECT_EQ(error_of({}), "picture: the image file is empty");
  const std::vector<uint8_t> text = {'h', 'e', 'l', 'l', 'o'};
  EXPECT_EQ(error_of(text),
            "picture: unknown image format; PNG, JPEG, OpenEXR, HDR, PFM, BMP and TGA can be read");
  EXPECT_EQ(error_of(read_file("luminance_chroma.exr")),
            "picture: OpenEXR image: luminance-chroma pixels are not supported; store R, G, B");
  EXPECT_EQ(error_of(read_file("deep.exr")),
            "picture: OpenEXR image: deep pixels are not supported; flatten the image");
  EXPECT_EQ(error_of(read_file("subsampled.exr")),
            "picture: OpenEXR image: channel R is subsampled, which is not supported");
  auto unnamed = read_file("half.exr");
  std::replace(unnamed.begin(), unnamed.end(), uint8_t{'G'}, uint8_t{'F'});
  EXPECT_EQ(error_of(unnamed),
            "picture: OpenEXR image: needs the channels R, G, B or Y; it has B, F, R");
}

// The frame header of a colour image with a fourth component behind its three.
TEST(ReadImage, RefusesCmykJpeg) {
  auto bytes = read_file("rgb.jpg");
  const std::array<uint8_t, 4> frame = {0xff, 0xc0, 0x00, 0x11};
  const auto found = std::search(bytes.begin(), bytes.end(), frame.begin(), frame.end());
  ASSERT_LT(found + 19, bytes.end());
  found[3] = 0x14;
  found[9] = 4;
  const std::array<uint8_t, 3> component = {4, 0x11, 0};
  bytes.insert(found + 19, component.begin(), component.end());
  EXPECT_EQ(error_of(bytes),
            "picture: JPEG image: CMYK colours are not supported; convert it to RGB");
}

TEST(ReadImage, RefusesSizesBeforeTakingMemory) {
  EXPECT_EQ(error_of(read_file("rgb8.png"), 60), "");
  EXPECT_EQ(error_of(read_file("rgb8.png"), 59),
            "picture: PNG image: 5 x 4 pixels take 60 bytes of memory; of a file of 110 bytes at "
            "most 59 are allowed");
  EXPECT_EQ(error_of(read_file("half.exr"), 319).substr(0, 64),
            "picture: OpenEXR image: 5 x 4 pixels take 320 bytes of memory; o");
  const auto png = [](std::array<uint8_t, 8> size) {
    auto bytes = read_file("rgb8.png");
    std::copy(size.begin(), size.end(), bytes.begin() + 16);
    return error_of(bytes);
  };
  EXPECT_EQ(png({0, 0, 0x40, 0, 0, 0, 0x40, 0}),
            "picture: PNG image: the header promises 16384 x 16384 pixels, more than the file's "
            "110 bytes can hold");
  EXPECT_EQ(png({0, 0, 0x40, 0, 0, 0, 0x40, 1}),
            "picture: PNG image: 16384 x 16385 pixels; at most 268435456 are allowed");
  EXPECT_NE(png({0, 0, 0, 0, 0, 0, 0, 4}), "");
  EXPECT_NE(png({0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff}), "");
}

// Little files that stand for gigabytes: what their headers say is enough.
TEST(ReadImage, RefusesMoreMemoryThanAFileOfItsSizeMayTake) {
  const std::string text = "#?RADIANCE\n\n-Y 8192 +X 16384\n";
  std::vector<uint8_t> hdr(text.begin(), text.end());
  hdr.resize(4096, 1);
  EXPECT_EQ(error_of(hdr),
            "picture: Radiance HDR image: 16384 x 8192 pixels take 1610612736 bytes of memory; of "
            "a file of 4096 bytes at most 268697600 are allowed");
  auto exr = read_file("half.exr");
  const std::string window = "dataWindow";
  const auto found = std::search(exr.begin(), exr.end(), window.begin(), window.end());
  ASSERT_LT(found + 36, exr.end());
  found[29] = found[33] = 0x40;  // up to pixel 8000 in either direction
  found[30] = found[34] = 0x1f;
  exr.resize(4096);
  EXPECT_NE(error_of(exr).find(" bytes of memory; of a file of 4096 bytes at most 268697600 are"),
            std::string::npos)
      << error_of(exr);
}

// A colour pixel has 24 bits, of which deflate packs at most 1032 into one.
TEST(ReadImage, PngDataMustSufficeForAllBitsOfAPixel) {
  auto bytes = read_file("rgb8.png");
  bytes[18] = bytes[22] = 0x01;
  bytes[19] = bytes[23] = 0x2c;
  EXPECT_EQ(error_of(bytes),
            "picture: PNG image: the header promises 300 x 300 pixels, more than the file's 110 "
            "bytes can hold");
}

// Decoding a damaged file ends, with pixels that fit the size or with an error.
void expect_image_or_error(std::span<const uint8_t> bytes) {
  const auto image = read_image(bytes, "damaged", Encoding::kSrgb, 1 << 20);
  if (!image) {
    EXPECT_FALSE(image.error().message.empty());
    return;
  }
  const scene::Image& i = image.value();
  const size_t size = std::visit([](const auto& p) { return p.size(); }, i.pixels);
  EXPECT_EQ(size, static_cast<size_t>(i.width) * i.height * i.channels);
}

class EveryFile : public ::testing::TestWithParam<std::string> {};

// A file may end with bytes that nobody needs (a PNG's last checksum).
TEST_P(EveryFile, TruncatedIsAnErrorOrComplete) {
  const auto bytes = read_file(GetParam());
  const auto whole = read_image(bytes, "whole", Encoding::kSrgb);
  for (size_t size = 0; size < bytes.size(); ++size) {
    // A copy of just that size, so that the address sanitizer sees reads beyond it.
    const std::vector<uint8_t> part(bytes.begin(), bytes.begin() + size);
    const auto image = read_image(part, "part", Encoding::kSrgb);
    EXPECT_TRUE(!image.ok() || image.value().pixels == whole.value().pixels) << size;
  }
}

TEST_P(EveryFile, FlippedBitsDoNoHarm) {
  auto bytes = read_file(GetParam());
  for (size_t i = 0; i < bytes.size(); ++i)
    for (const uint8_t flip : {0x01, 0x80, 0xff}) {
      bytes[i] ^= flip;
      expect_image_or_error(bytes);
      bytes[i] ^= flip;
    }
}

INSTANTIATE_TEST_SUITE_P(Files, EveryFile, ::testing::ValuesIn(file_names()), [](const auto& file) {
  std::string name = file.param;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
});

}  // namespace
}  // namespace metrofarm::image_io::test
