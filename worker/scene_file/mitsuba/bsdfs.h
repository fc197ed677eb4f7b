// <bsdf> elements.
#pragma once

#include <string_view>
#include <vector>

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// Index of the material that the element describes; it is loaded if this is its first use.
scene::Index load_bsdf(const Element& element, Context& context);

// The material of a shape that names none: grey, or black if the shape is a light (as in Mitsuba).
scene::Index default_bsdf(bool for_emitter, Context& context);

// The supported plugins.
std::vector<std::string_view> bsdf_types();

}  // namespace metrofarm::scene_file::mitsuba
