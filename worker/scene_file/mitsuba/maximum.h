#pragma once

#include "scene/description.h"

namespace metrofarm::scene_file::mitsuba {

// The largest value of each channel anywhere on a surface; of mesh attributes, that are not read
// yet, the most that a reflectance can be.
scene::Rgb maximum_of(const scene::Colour& colour, const scene::SceneDescription& scene);

}  // namespace metrofarm::scene_file::mitsuba
