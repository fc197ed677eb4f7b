// Linear Rec. 709 RGB, the renderer's spectrum: a Vec3 of lanes whose x, y, z are R, G, B.
#pragma once

#include "math/vec.h"
#include "spectrum/luminance.h"

namespace metrofarm {

using Spectrum = Vec3;

// Lanes that are not black. A NaN is not black either: it must go on to where it is counted (and
// the lanes' != is false for it).
inline Mask not_black(const Spectrum& s) {
  return ~((s.x == Float(0.F)) & (s.y == Float(0.F)) & (s.z == Float(0.F)));
}

inline Float luminance(const Spectrum& s) {
  return s.x * Float(kLuminanceR) + s.y * Float(kLuminanceG) + s.z * Float(kLuminanceB);
}

}  // namespace metrofarm
