// The plugins for <bsdf> that are made of others.
#pragma once

#include "scene_file/mitsuba/bsdf_models.h"

namespace metrofarm::scene_file::mitsuba {

BsdfModel load_twosided(Properties& properties, Context& context);
BsdfModel load_mask(Properties& properties, Context& context);
BsdfModel load_blend(Properties& properties, Context& context);
BsdfModel load_mixture(Properties& properties, Context& context);  // 0.6
BsdfModel load_bump_map(Properties& properties, Context& context);
BsdfModel load_normal_map(Properties& properties, Context& context);

}  // namespace metrofarm::scene_file::mitsuba
