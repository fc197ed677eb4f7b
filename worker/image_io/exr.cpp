// OpenEXR, through its own library.
#include <ImfChannelList.h>
#include <ImfChromaticities.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfTileDescription.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>
#include <stdexcept>

#include "image_io/exr_header.h"
#include "image_io/formats.h"

namespace metrofarm::image_io {
namespace {

class MemoryStream : public Imf::IStream {
 public:
  explicit MemoryStream(std::span<const uint8_t> bytes) : IStream("memory"), bytes_(bytes) {}

  bool read(char out[], int count) override {
    if (count < 0 || static_cast<size_t>(count) > bytes_.size() - at_)
      throw std::runtime_error("the file ends early");
    if (count > 0) std::memcpy(out, bytes_.data() + at_, count);
    at_ += count;
    return at_ < bytes_.size();
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t position) override { at_ = std::min<uint64_t>(position, bytes_.size()); }

 private:
  std::span<const uint8_t> bytes_;
  size_t at_ = 0;
};

std::string channel_names(const Imf::ChannelList& channels) {
  std::string names;
  for (auto c = channels.begin(); c != channels.end(); ++c)
    names += (names.empty() ? "" : ", ") + std::string(c.name());
  return names;
}

// The file's channels in the order of the image's.
Result<std::vector<const char*>> choose_channels(const Imf::ChannelList& channels) {
  const auto has = [&](const char* name) { return channels.findChannel(name) != nullptr; };
  std::vector<const char*> chosen;
  if (has("R") && has("G") && has("B")) {
    chosen = {"R", "G", "B"};
    if (has("A")) chosen.push_back("A");
  } else if (has("RY") || has("BY")) {
    return Error{"luminance-chroma pixels are not supported; store R, G, B"};
  } else if (has("Y")) {
    chosen = {"Y"};
  } else {
    return Error{"needs the channels R, G, B or Y; it has " + channel_names(channels)};
  }
  for (const char* name : chosen)
    if (channels[name].xSampling != 1 || channels[name].ySampling != 1)
      return Error{"channel " + std::string(name) + " is subsampled, which is not supported"};
  return chosen;
}

// Of the library's buffers, which hold all channels of the file, or of ours if that is more.
uint64_t bytes_per_pixel(const Imf::Header& header) {
  uint64_t stored = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
    stored += c.channel().type == Imf::HALF ? 2 : 4;
  return std::max<uint64_t>(stored, 4 * sizeof(float));
}

// The library takes memory for whole tiles, which may be larger than the image.
std::optional<Error> check_tiles(const Source& source, const Imf::Header& header) {
  if (!header.hasTileDescription()) return std::nullopt;
  const Imf::TileDescription& tile = header.tileDescription();
  const uint64_t bytes = uint64_t{tile.xSize} * tile.ySize;
  if (bytes <= source.max_bytes / bytes_per_pixel(header)) return std::nullopt;
  return Error{"tiles of " + std::to_string(tile.xSize) + " x " + std::to_string(tile.ySize) +
               " pixels, more than " + std::to_string(source.max_bytes) + " bytes of memory"};
}

// Only the header of the first part: the library allocates by what it says.
Imf::Header read_header(MemoryStream& stream) {
  constexpr int kMagicAndVersion = 8;
  Imf::Header header;
  char start[kMagicAndVersion];
  stream.read(start, kMagicAndVersion);
  int version = 0;
  std::memcpy(&version, start + 4, sizeof version);
  header.readFrom(stream, version);
  stream.seekg(0);
  return header;
}

// From the file's primaries to Rec. 709 (ImfChromaticities.h: row vectors).
void convert_primaries(const Imf::Header& header, std::vector<float>& pixels, int channels) {
  if (channels < 3 || !Imf::hasChromaticities(header)) return;
  const Imf::Chromaticities file = Imf::chromaticities(header), rec709;
  const auto near = [](const Imath::V2f& a, const Imath::V2f& b) {
    return std::abs(a.x - b.x) < 1e-4F && std::abs(a.y - b.y) < 1e-4F;
  };
  if (near(file.red, rec709.red) && near(file.green, rec709.green) &&
      near(file.blue, rec709.blue) && near(file.white, rec709.white))
    return;
  const Imath::M44f m = Imf::RGBtoXYZ(file, 1) * Imf::XYZtoRGB(rec709, 1);
  for (size_t i = 0; i + 2 < pixels.size(); i += channels) {
    const Imath::V3f rgb(pixels[i], pixels[i + 1], pixels[i + 2]);
    for (int c = 0; c < 3; ++c) pixels[i + c] = rgb.x * m[0][c] + rgb.y * m[1][c] + rgb.z * m[2][c];
  }
}

Result<scene::Image> read_pixels(const Source& source) {
  if (!exr_attributes_fit(source.bytes)) return Error{"the header is damaged or ends early"};
  MemoryStream stream(source.bytes);
  const Imf::Header first = read_header(stream);
  const Imath::Box2i& window = first.dataWindow();
  const int64_t width = int64_t{window.max.x} - window.min.x + 1;
  const int64_t height = int64_t{window.max.y} - window.min.y + 1;
  if (first.hasType() && Imf::isDeepData(first.type()))
    return Error{"deep pixels are not supported; flatten the image"};
  const Result<std::vector<const char*>> names = choose_channels(first.channels());
  if (!names) return names.error();
  // Wavelet compression may shrink a block of equal pixels to next to nothing.
  const Claim claim = {width, height, source.bytes.size() * 65536, bytes_per_pixel(first)};
  if (const auto error = check_claim(source, claim)) return *error;
  if (const auto error = check_tiles(source, first)) return *error;

  Imf::InputFile file(stream);
  if (!file.isComplete()) return Error{"the file ends early: rows or tiles are missing"};
  const int channels = static_cast<int>(names.value().size());
  std::vector<float> pixels(static_cast<size_t>(width) * height * channels);
  Imf::FrameBuffer frame;
  for (int c = 0; c < channels; ++c)
    frame.insert(names.value()[c],
                 Imf::Slice::Make(Imf::FLOAT, pixels.data() + c, window, sizeof(float) * channels,
                                  sizeof(float) * channels * width));
  file.setFrameBuffer(frame);
  file.readPixels(window.min.y, window.max.y);
  convert_primaries(first, pixels, channels);
  return scene::Image{static_cast<int>(width), static_cast<int>(height), channels,
                      std::move(pixels)};
}

}  // namespace

Result<scene::Image> read_exr(const Source& source) {
  try {
    return read_pixels(source);
  } catch (const std::exception& e) {
    return Error{e.what()};
  }
}

}  // namespace metrofarm::image_io
