// Shapes that need no file.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

// Each sets the geometry (and flips the normals where its transform does).
void load_rectangle(Properties& properties, scene::Shape& shape, Context& context);
void load_cube(Properties& properties, scene::Shape& shape, Context& context);
void load_sphere(Properties& properties, scene::Shape& shape, Context& context);
void load_disk(Properties& properties, scene::Shape& shape, Context& context);
void load_cylinder(Properties& properties, scene::Shape& shape, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
