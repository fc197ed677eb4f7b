// <emitter type="sunsky">, "sky" and "sun": a model of the clear sky as a baked environment image.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// Always warns: the image has a finite resolution.
decltype(scene::Emitter::model) load_sky(Properties& properties, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
