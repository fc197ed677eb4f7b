// How people see spectra: the colour matching functions of the CIE 1931 standard observer, and the
// standard illuminant D65.
#pragma once

namespace metrofarm::scene_file {

struct CieRow {
  double x, y, z;  // colour matching functions
  double d65;      // relative power; the mean of d65 y over that of y is near 1
};

inline constexpr double kCieFirst = 360;  // nm
inline constexpr double kCieLast = 830;   // nm
inline constexpr double kCieStep = 5;     // nm
inline constexpr int kCieRows = 95;

// One row each kCieStep, to be interpolated linearly.
extern const CieRow kCieTable[kCieRows];

}  // namespace metrofarm::scene_file
