// The plugin-style name of each element of a scene, for reports and messages.
#pragma once

#include "scene/description.h"

namespace metrofarm::scene {

const char* kind_of(const Shape& shape);
const char* kind_of(const Texture& texture);
const char* kind_of(const Bsdf& bsdf);
const char* kind_of(const Emitter& emitter);
const char* kind_of(Projection projection);

}  // namespace metrofarm::scene
