// Lights of pbrt. Emission of 1 is a radiance (intensity, irradiance) of 1 per channel, because
// pbrt-v4 divides every light by the luminance of its spectrum and its film undoes no more than
// the imaging ratio.
#pragma once

#include "scene_file/pbrt/context.h"

namespace metrofarm::scene_file::pbrt {

// A LightSource directive under the current transform.
void load_light(Entity& entity, const Matrix& to_world, Context& context);

// What an AreaLightSource directive says; apply_area_light turns it into emitters.
struct AreaLight {
  scene::Rgb radiance = {1, 1, 1};
  double power = 0;  // if greater than 0: of each triangle, in units of luminance
  bool two_sided = false;
  SourceLocation where;
};

AreaLight read_area_light(Entity& entity, Context& context);

// Makes `shape` a light and returns the index of its emitter.
scene::Index add_area_emitter(const AreaLight& light, const scene::Shape& shape, Context& context);

}  // namespace metrofarm::scene_file::pbrt
