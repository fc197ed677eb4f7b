// Colours and spectra as linear Rec. 709 RGB.
#pragma once

#include <string_view>

#include "scene/description.h"
#include "scene_file/mitsuba/properties.h"

namespace metrofarm::scene_file::mitsuba {

enum class ColourUse {
  kReflectance,  // within [0, 1]
  kEmission,     // not negative; a constant <spectrum> is white of equal energy, as in Mitsuba
  kIndex,        // refractive indices: not negative
};

// <rgb value="r, g, b | r g b | grey | #rrggbb">, <float>, or a constant <spectrum>. A colour in
// "#rrggbb" is sRGB-encoded.
scene::Rgb read_colour(Properties& properties, std::string_view name, const scene::Rgb& fallback,
                       ColourUse use);

}  // namespace metrofarm::scene_file::mitsuba
