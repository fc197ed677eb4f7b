// <integrator>: what the file asks of the renderer.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// An integrator is a request and no content: those that are not known here become `path`, with a
// warning.
void load_integrator(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
