// What is known of a set of lights from outside: where they are, how strong they are and to which
// side they shine. For building, in double precision; see LightTree.
#pragma once

#include <array>

namespace metrofarm::emitter {

using Double3 = std::array<double, 3>;

// Directions within an angle of an axis. The angle is kept as its cosine: -1 is all directions.
struct Cone {
  Double3 axis = {0, 0, 1};  // unit
  double cosine = 1;
};

struct LightBounds {
  Double3 lower, upper;  // box around the lights
  // Sum of the lights' intensities, W/sr by weight_of(), each where it is greatest.
  double intensity = 0;
  Cone normals;           // holds all directions of full intensity
  double cos_spread = 0;  // of the angle beyond the cone within which there is any light
};

inline constexpr double kAllDirections = -1;

// The smallest cone around both, or nearly.
Cone cone_around(const Cone& a, const Cone& b);
LightBounds bounds_of(const LightBounds& a, const LightBounds& b);

// The cone around three directions, which need not be unit vectors; all directions where they lie
// in no hemisphere.
Cone cone_around(const std::array<Double3, 3>& directions);

// Solid angle that is lit, weighted by the cosine beyond the cone of normals; sr.
// Conty Estevez and Kulla 2018, equation 1.
double lit_solid_angle(const LightBounds& bounds);

// Whether a tree can hold it: numbers that are finite, an intensity above zero.
bool usable(const LightBounds& bounds);

}  // namespace metrofarm::emitter
