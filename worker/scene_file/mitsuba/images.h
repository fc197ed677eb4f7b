// Image files of textures.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

enum class ImageChannels { kAll, kRed, kGreen, kBlue, kAlpha };

// How the pixels of a file become values.
struct ImageDecoding {
  bool srgb = true;  // integer pixels are sRGB-encoded
  double gamma = 1;  // else they are to be raised to this power
  ImageChannels channels = ImageChannels::kAll;
};

// From the parameters of a bitmap: raw since version 2; gamma and channel before it.
ImageDecoding read_decoding(Properties& properties);

// Index of the image in the file named by the parameter "filename"; kNone after a problem. The same
// file with the same decoding is loaded once.
scene::Index load_image(Properties& properties, const ImageDecoding& decoding, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
