// What a BSDF is asked and what it answers, for eight surface points at once.
//
// Directions are unit vectors in the local shading frame, +z the shading normal, both pointing away
// from the surface. Two-sided materials see wo.z > 0 from either side: the frame is turned for
// them.
#pragma once

#include "math/warp.h"
#include "spectrum/rgb.h"

namespace metrofarm::bsdf {

struct Evaluation {
  Spectrum value = splat(0.F);         // f(wo, wi) |cos theta_i|
  Float pdf_solid_angle = Float(0.F);  // of sample() choosing wi; 0 for delta lobes
};

struct Sample {
  Vec3 wi = splat(0.F);
  Spectrum weight = splat(0.F);        // value / pdf
  Float pdf_solid_angle = Float(0.F);  // meaningless in delta lanes
  Mask valid = no_lanes();             // lanes without a sample carry no light
  Mask delta = no_lanes();             // wi came from a discrete set of directions
  Float eta = Float(1.F);              // index ratio passed through, 1 on reflection
};

// Which quantity travels along the path that is being built: radiance from the eye, importance from
// a light. Refraction scales radiance by the squared index ratio (Veach 1997, section 5.2).
enum class Transport { kRadiance, kImportance };

// The primary sample of one scattering event.
struct SampleInput {
  Float lobe;      // chooses among discrete lobes
  Vec2 direction;  // chooses within a lobe
};

}  // namespace metrofarm::bsdf
