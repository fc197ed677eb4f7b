// <film> with its crop window and reconstruction filter, and <sampler>.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

void load_film(const Element& element, Context& context);

// Every sampler is accepted: only the number of samples is of interest.
void load_sampler(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
