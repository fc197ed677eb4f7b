// The plugins for <bsdf> that nest no other.
#pragma once

#include "scene_file/mitsuba/context.h"

namespace metrofarm::scene_file::mitsuba {

using BsdfModel = decltype(scene::Bsdf::model);

BsdfModel load_diffuse(Properties& properties, Context& context);
BsdfModel load_rough_diffuse(Properties& properties, Context& context);        // 0.6
BsdfModel load_diffuse_transmitter(Properties& properties, Context& context);  // 0.6
BsdfModel load_conductor(Properties& properties, Context& context);
BsdfModel load_rough_conductor(Properties& properties, Context& context);
BsdfModel load_dielectric(Properties& properties, Context& context);
BsdfModel load_thin_dielectric(Properties& properties, Context& context);
BsdfModel load_rough_dielectric(Properties& properties, Context& context);
BsdfModel load_plastic(Properties& properties, Context& context);
BsdfModel load_rough_plastic(Properties& properties, Context& context);
BsdfModel load_phong(Properties& properties, Context& context);  // 0.6
BsdfModel load_principled(Properties& properties, Context& context);
BsdfModel load_principled_thin(Properties& properties, Context& context);
BsdfModel load_null(Properties& properties, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
