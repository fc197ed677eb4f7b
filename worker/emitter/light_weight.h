// How much a colour counts when lights are chosen. Not the luminance alone: where there is any
// light at all the weight is above zero, so light of one saturated colour is found too.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "scene/description.h"
#include "spectrum/rgb.h"

namespace metrofarm::emitter {

inline constexpr float kColourShare = 0.01F;  // of the largest channel

// At least kColourShare of the largest channel's magnitude. Of what is no number 1: such light is
// kept, so that its contributions are found and counted.
inline Float weight_of(const Spectrum& s) {
  const Spectrum magnitude = abs(s);
  const Float brightness = luminance(magnitude);  // no number if one channel is none
  const Float weight = xsimd::max(brightness, Float(kColourShare) * max_component(magnitude));
  return select(brightness < Float(std::numeric_limits<float>::infinity()), weight, Float(1.F));
}

inline double sum_of_lanes(Float f) {
  double sum = 0;
  for (int lane = 0; lane < kLanes; ++lane) sum += lane_value(f, lane);
  return sum;
}

inline double weight_of(const scene::Rgb& rgb) {
  return lane_value(weight_of(splat(rgb[0], rgb[1], rgb[2])), 0);
}

}  // namespace metrofarm::emitter
