// <transform>: steps in document order, each applied after those before it; <animation>: transforms
// at given times.
#pragma once

#include <vector>

#include "scene_file/affine.h"
#include "scene_file/mitsuba/element.h"
#include "scene_file/problems.h"

namespace metrofarm::scene_file::mitsuba {

Matrix read_transform(const Element& transform, Problems& problems);

// The <transform time="..."> children in the order of their times; at least one unless there is a
// problem.
scene::Motion read_animation(const Element& animation, Problems& problems);

}  // namespace metrofarm::scene_file::mitsuba
