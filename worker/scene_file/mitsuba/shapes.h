// <shape> elements.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// Appends the shape (or the instance) with its material and light to the scene. Mesh files are only
// queued. A shapegroup comes with its first instance.
void load_shape(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
