// Reconstruction filters: separable, normalized so that the integral over the plane is 1. Weights
// can be negative (Mitchell, Catmull-Rom, Lanczos).
#pragma once

#include <array>

#include "scene/description.h"

namespace metrofarm::film {

class Filter {
 public:
  // Pixels per axis that one splat can reach.
  static constexpr int kMaxReach = 40;

  // Requires: reach of the radius below kMaxReach (see fits()).
  explicit Filter(const scene::Film& film);
  static bool fits(double radius) { return 2 * radius + 1 < kMaxReach; }

  bool is_pixel_box() const { return is_pixel_box_; }
  // Pixels by which the sampled domain exceeds the image on each side, so that no energy is lost.
  int border() const { return border_; }

  // The pixels along one axis that a splat at raster coordinate x reaches.
  struct Span {
    int first = 0;
    int count = 0;
    std::array<float, kMaxReach> weight;
  };
  Span span(float x) const;

 private:
  float value(float distance) const;

  scene::ReconstructionFilter kind_;
  bool is_pixel_box_;
  int border_;
  float radius_;
  float scale_;              // makes the integral 1
  float inverse_variance2_;  // 1 / (2 sigma^2), gaussian only
  float at_radius_;          // gaussian value subtracted so that it ends at zero
  float b_, c_;              // of the cubics: Mitchell's, or 0 and 1/2 for Catmull and Rom's
};

}  // namespace metrofarm::film
