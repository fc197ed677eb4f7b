// The transfer function of sRGB (IEC 61966-2-1), for use at load.
#pragma once

#include <cmath>

namespace metrofarm {

// Linear light of an encoded value; both in [0, 1].
inline double srgb_to_linear(double encoded) {
  return encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4);
}

}  // namespace metrofarm
