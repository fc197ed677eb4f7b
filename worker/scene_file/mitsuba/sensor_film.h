// <sensor> with its film, filter and sampler, and <integrator>.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

void load_sensor(const Element& element, Context& context);
void load_integrator(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
