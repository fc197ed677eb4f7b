// <sensor> with its film and sampler.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// The horizontal field of view in degrees, from "fov" and "fov_axis" or from "focal_length".
// aspect: width over height.
double read_fov_x(Properties& properties, double aspect);

void load_sensor(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
