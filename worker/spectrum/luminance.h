// Luminance of linear Rec. 709 RGB.
#pragma once

namespace metrofarm {

inline constexpr float kLuminanceR = 0.212671F;
inline constexpr float kLuminanceG = 0.715160F;
inline constexpr float kLuminanceB = 0.072169F;

inline constexpr float luminance(const float rgb[3]) {
  return rgb[0] * kLuminanceR + rgb[1] * kLuminanceG + rgb[2] * kLuminanceB;
}

}  // namespace metrofarm
