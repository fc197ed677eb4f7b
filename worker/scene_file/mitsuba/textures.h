// <texture> elements, images, and parameters that may be textured.
#pragma once

#include <string_view>
#include <vector>

#include "scene_file/mitsuba/colours.h"
#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// What the element stands for: a colour, a texture, or a texture times a colour. An element that
// several others refer to is loaded once. After a problem it is grey.
scene::Colour load_textured_colour(const Element& element, ColourUse use, Context& context);

// Index of the texture that the element describes, for uses that need a texture as it is: scaled
// and constant ones are a problem. kNone after a problem.
scene::Index load_texture(const Element& element, Context& context);

// A colour, a spectrum or a texture, nested or referenced.
scene::Colour read_textured_colour(Properties& properties, std::string_view name,
                                   const scene::Colour& fallback, ColourUse use, Context& context);

// The values that a parameter may have.
struct Range {
  double lowest = 0;
  double highest = 1;
};

// A number, a texture whose luminance counts, or a colour whose mean counts (as in Mitsuba 3). A
// texture's values are not checked.
scene::Scalar read_textured_number(Properties& properties, std::string_view name, double fallback,
                                   const Range& range, Context& context);

// The nested or referenced texture that has no name of its own meaning, apart from the child called
// `except`; nullptr if there is none. Mitsuba 2 writes textures as <spectrum>.
const Element* find_nested_texture(Properties& properties, std::string_view except = "");

// Plugins for textures, apart from spectrum_types().
std::vector<std::string_view> texture_types();

// Index of the image in the file named by the element's parameter "filename"; kNone after a
// problem. srgb: integer pixels are sRGB-encoded (files in floating point are always linear). The
// same file with the same encoding is loaded once.
scene::Index load_image(Properties& properties, bool srgb, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
