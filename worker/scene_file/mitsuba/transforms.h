// <transform>: steps in document order, each applied after those before it.
#pragma once

#include "scene_file/affine.h"
#include "scene_file/mitsuba/element.h"
#include "scene_file/problems.h"

namespace metrofarm::scene_file::mitsuba {

Matrix read_transform(const Element& transform, Problems& problems);

}  // namespace metrofarm::scene_file::mitsuba
