// The equalized target: f is luminance over a rough image of the scene, so that chains seek equal
// relative error all over the film instead of going where most light is.
#pragma once

#include <vector>

#include "math/lanes.h"

namespace metrofarm::work_unit {

inline constexpr int kLargestMapSide = 64;

// See metrofarm.job.v1.TargetMap.
struct TargetMapValues {
  int side = 0;               // 0: the target is luminance
  std::vector<float> values;  // side x side, row by row from the top
};

class TargetMap {
 public:
  // Requires: values are positive, side * side of them.
  TargetMap(const TargetMapValues& map, int width, int height);

  bool empty() const { return side_ == 0; }
  // What luminance at these raster positions is multiplied by. Requires: not empty.
  Float factor(Float raster_x, Float raster_y, Mask lanes) const;

 private:
  int side_;
  std::vector<float> values_;
  float cells_per_x_, cells_per_y_;
};

// Cells of a map of where light lands, over the image; see metrofarm.farm.v1.BootstrapResult.map.
class LightMap {
 public:
  static constexpr int kSide = kLargestMapSide;

  LightMap(int width, int height) : sums_(size_t{kSide} * kSide), width_(width), height_(height) {}

  void add(float raster_x, float raster_y, float luminance);
  const std::vector<double>& sums() const { return sums_; }

 private:
  std::vector<double> sums_;
  int width_, height_;
};

}  // namespace metrofarm::work_unit
