// pbrt-v4's environment maps: square images in Clarberg's equal-area octahedral mapping.
#pragma once

#include <array>

#include "base/result.h"
#include "scene/description.h"
#include "scene_file/affine.h"

namespace metrofarm::scene_file::pbrt {

// Where in the unit square (v downwards) the unit direction lies; z > 0 is the inner diamond.
// Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD".
std::array<double, 2> equal_area_square(const Point& direction);

// The map as the latitude-longitude image of scene::EnvironmentEmitter, in the same space, with
// about as many pixels per solid angle at the horizon. Errors (without a location): the map isn't
// square, or a pixel is not finite.
Result<scene::Image> to_latitude_longitude(const scene::Image& map);

// Luminance that pbrt-v4 finds arriving on a surface across +z, by which it divides "illuminance".
// (pbrt's sum takes each pixel for half its solid angle, so the result is half the true one.)
double upward_illuminance(const scene::Image& map);

}  // namespace metrofarm::scene_file::pbrt
