// Coefficients of the clear-sky models of Hosek and Wilkie: "An Analytic Model for Full Spectral
// Sky-Dome Radiance" (2012) and "Adding a Solar-Radiance Function to the Hosek-Wilkie Skylight
// Model" (2013), as their authors published them (3-clause BSD, Charles University in Prague),
// for linear Rec. 709 RGB.
#pragma once

#include <array>

namespace metrofarm::scene_file::mitsuba {

// [turbidity 1..10][albedo 0 and 1][Bezier control point][RGB][coefficient A..I].
extern const std::array<float, 10UL * 2 * 6 * 3 * 9> kSkyShapes;
// [turbidity][albedo][Bezier control point][RGB]: factor in W / (m^2 sr).
extern const std::array<float, 10UL * 2 * 6 * 3> kSkyRadiances;
// [turbidity][i][RGB]: mean radiance of the sun's disk at an elevation of (i / 23)^2 * 90 degrees.
extern const std::array<float, 10UL * 24 * 3> kSunRadiances;

}  // namespace metrofarm::scene_file::mitsuba
