// Colours and spectra as linear Rec. 709 RGB.
#pragma once

#include <string_view>
#include <vector>

#include "scene/description.h"
#include "scene_file/mitsuba/context.h"
#include "scene_file/mitsuba/properties.h"

namespace metrofarm::scene_file::mitsuba {

enum class ColourUse {
  kReflectance,  // within [0, 1]
  kEmission,     // not negative; a constant <spectrum> is white of equal energy, as in Mitsuba
  kIndex,        // refractive indices: not negative
};

// <rgb value="r, g, b | r g b | grey | #rrggbb">, <float>, or a <spectrum>: a constant, pairs of
// wavelength and value, a file of them, or one of spectrum_types(). A colour in "#rrggbb" is
// sRGB-encoded.
scene::Rgb read_colour(Properties& properties, std::string_view name, const scene::Rgb& fallback,
                       ColourUse use, Context& context);

// Whether the element is a colour in one of these forms; else it may be a texture.
bool is_colour(const Element& element);

// The colour that the element is. what: how messages call it. Requires: is_colour(element).
scene::Rgb load_colour(const Element& element, std::string_view what, ColourUse use,
                       Context& context);

// Plugins that stand for a colour.
std::vector<std::string_view> spectrum_types();

}  // namespace metrofarm::scene_file::mitsuba
