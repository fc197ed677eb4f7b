// Shapes that stand in files of their own.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// Each queues the file; the shape is the next one to be appended to the scene and gets its geometry
// when the queue is loaded.
void load_obj(Properties& properties, scene::Shape& shape, Context& context);
// A sequence of ply files, each with its time.
void load_deformable(Properties& properties, scene::Shape& shape, Context& context);
void load_ply(Properties& properties, scene::Shape& shape, Context& context);
void load_serialized(Properties& properties, scene::Shape& shape, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
