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
  Float time = Float(0.F);  // of its path, see geometry::Tracer
};

struct LightSample {
  Vec3 direction = splat(0.F);  // unit, from the receiver towards the light
  Float distance = Float(0.F);  // to the light; infinite for environments and parallel light
  Spectrum value = splat(0.F);  // radiance (delta: intensity / d^2) over the pdf of choosing it
  Float pdf_solid_angle = Float(0.F);  // of the whole choice; 0 in delta lanes
  Mask valid = no_lanes();             // some light comes from there, if nothing is in its way
  Mask delta = no_lanes();
  Int light = Int(0);          // its number in the LightTable
  Float pick = Float(0.F);     // probability of choosing it
  Float cosine = Float(1.F);   // at surfaces that radiate, below 0 behind them; else 1
  Float stretch = Float(1.F);  // of such a surface's area there and then, see AreaLights::stretch()
  Float time = Float(0.F);     // of the receiver
};

// Where a path that starts at a light begins. Density: of the ray, by area across it and solid
// angle, without the parts that a delta light leaves no choice in.
struct Emission {
  Int light = Int(0);
  Vec3 origin = splat(0.F);     // of the first ray, off the light's surface
  Vec3 direction = splat(0.F);  // unit
  Spectrum power = splat(0.F);  // radiance times cosine (delta: intensity, irradiance) / density
  Vec3 position = splat(0.F);   // on lights with a surface, and their
  Vec3 normal = splat(0.F);     // unit normal there
  Float cosine = Float(1.F);    // between direction and normal; 1 where there is no surface
  Float time = Float(0.F);      // at which it is emitted
  Float pdf = Float(0.F);       // 1 / (m^2 sr); of point lights 1 / sr, of parallel light 1 / m^2
  Mask valid = no_lanes();
  Mask delta = no_lanes();  // chance never meets the light
};

}  // namespace metrofarm::emitter
