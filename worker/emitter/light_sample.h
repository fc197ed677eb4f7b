// What every kind of light answers when asked for light at a point.
#pragma once

#include "math/warp.h"
#include "spectrum/rgb.h"

namespace metrofarm::emitter {

// A point that asks for light.
struct Receiver {
  Vec3 position = splat(0.F);
  // Shading normal, unit, on the side from which light counts; zero where it counts from both. It
  // only guides the choice of a light.
  Vec3 normal = splat(0.F);
};

struct LightSample {
  Vec3 direction = splat(0.F);  // unit, from the receiver towards the light
  Float distance = Float(0.F);  // to the light; infinite for environments and parallel light
  Spectrum value = splat(0.F);  // radiance (delta: intensity / d^2) over the pdf of choosing it
  Float pdf_solid_angle = Float(0.F);  // of the whole choice; 0 in delta lanes
  Mask valid = no_lanes();             // some light comes from there, if nothing is in its way
  Mask delta = no_lanes();
};

}  // namespace metrofarm::emitter
