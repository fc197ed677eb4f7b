// <emitter> elements.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// A light of the scene itself. An area light that stands here is only a definition for shapes to
// refer to.
void load_scene_emitter(const Element& element, Context& context);

// The light of a shape; kNone if it can't be loaded.
scene::Index load_area_emitter(const Element& element, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
