// JPEG, through libjpeg-turbo: Mitsuba's decoder, so that both see the same bytes.
#include <turbojpeg.h>

#include <algorithm>
#include <array>
#include <memory>

#include "image_io/formats.h"

namespace metrofarm::image_io {
namespace {

struct Destroy {
  void operator()(void* decoder) const { tjDestroy(decoder); }
};

std::string message_of(tjhandle decoder) {
  return tjGetErrorStr2(decoder);
}

// Bytes between segments do no harm, and some programs write them.
bool is_serious(tjhandle decoder) {
  return tjGetErrorCode(decoder) == TJERR_FATAL ||
         message_of(decoder).find("extraneous bytes") == std::string::npos;
}

}  // namespace

Result<scene::Image> read_jpeg(const Source& source) {
  const std::unique_ptr<void, Destroy> decoder(tjInitDecompress());
  if (!decoder) return Error{"cannot start a decoder"};
  const unsigned char* data = source.bytes.data();
  const size_t length = source.bytes.size();
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (tjDecompressHeader3(decoder.get(), data, length, &width, &height, &subsampling, &colours) !=
          0 &&
      is_serious(decoder.get()))
    return Error{message_of(decoder.get())};
  if (colours == TJCS_CMYK || colours == TJCS_YCCK)
    return Error{"CMYK colours are not supported; convert it to RGB"};
  const int channels = colours == TJCS_GRAY ? 1 : 3;
  // At least 1 bit per block of 8 x 8.
  const Claim claim = {width, height, length * 8 * 64, static_cast<uint64_t>(channels)};
  if (const auto error = check_claim(source, claim)) return *error;
  constexpr std::array<uint8_t, 2> kEndMark = {0xff, 0xd9};
  if (std::find_end(source.bytes.begin(), source.bytes.end(), kEndMark.begin(), kEndMark.end()) ==
      source.bytes.end())
    return Error{"the file ends early"};
  std::vector<uint8_t> pixels(static_cast<size_t>(width) * height * channels);
  // A limit to the scans of a progressive image keeps time in proportion to the file's size.
  const int flags = TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS;
  if (tjDecompress2(decoder.get(), data, length, pixels.data(), width, 0, height,
                    channels == 1 ? TJPF_GRAY : TJPF_RGB, flags) != 0 &&
      is_serious(decoder.get()))
    return Error{message_of(decoder.get())};
  return scene::Image{width, height, channels, std::move(pixels),
                      source.encoding == Encoding::kSrgb};
}

}  // namespace metrofarm::image_io
