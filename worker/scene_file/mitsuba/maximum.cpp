#include "scene_file/mitsuba/maximum.h"

#include <algorithm>
#include <array>
#include <variant>
#include <vector>

#include "spectrum/srgb.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Image;
using scene::Rgb;

// Before decoding, which grows with the value.
template <class T>
std::array<T, 3> largest(const Image& image, const std::vector<T>& pixels) {
  std::array<T, 3> most = {};
  const auto channels = static_cast<size_t>(image.channels);
  for (size_t i = 0; i + channels <= pixels.size(); i += channels) {
    for (size_t c = 0; c < 3; ++c) {
      most[c] = std::max(most[c], pixels[i + (channels < 3 ? 0 : c)]);
    }
  }
  return most;
}

Rgb maximum_in(const Image& image) {
  if (const auto* floats = std::get_if<std::vector<float>>(&image.pixels)) {
    return largest(image, *floats);
  }
  const auto bytes = largest(image, std::get<std::vector<uint8_t>>(image.pixels));
  Rgb most;
  for (size_t c = 0; c < 3; ++c) {
    const double value = bytes[c] / 255.0;
    most[c] = static_cast<float>(image.srgb ? srgb_to_linear(value) : value);
  }
  return most;
}

Rgb maximum_in(const scene::Texture& texture, const scene::SceneDescription& scene) {
  if (const auto* bitmap = std::get_if<scene::BitmapTexture>(&texture.model)) {
    if (bitmap->image != scene::kNone) return maximum_in(scene.images[bitmap->image]);
  } else if (const auto* board = std::get_if<scene::CheckerboardTexture>(&texture.model)) {
    const Rgb a = mitsuba::maximum_of(board->colour0, scene);
    const Rgb b = mitsuba::maximum_of(board->colour1, scene);
    return {std::max(a[0], b[0]), std::max(a[1], b[1]), std::max(a[2], b[2])};
  }
  return {1, 1, 1};
}

}  // namespace

Rgb maximum_of(const scene::Colour& colour, const scene::SceneDescription& scene) {
  if (colour.texture == scene::kNone) return colour.value;
  Rgb most = maximum_in(scene.textures[colour.texture], scene);
  for (size_t c = 0; c < 3; ++c) most[c] *= colour.value[c];
  return most;
}

}  // namespace metrofarm::scene_file::mitsuba
