// <shape> elements.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// Appends the shape with its material and light to the scene.
void load_shape(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
