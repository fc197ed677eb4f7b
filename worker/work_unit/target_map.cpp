#include "work_unit/target_map.h"

#include <algorithm>

namespace metrofarm::work_unit {

TargetMap::TargetMap(const TargetMapValues& map, int width, int height)
    : side_(map.side),
      values_(map.values),
      cells_per_x_(static_cast<float>(map.side) / static_cast<float>(width)),
      cells_per_y_(static_cast<float>(map.side) / static_cast<float>(height)) {}

Float TargetMap::factor(Float raster_x, Float raster_y, Mask lanes) const {
  const Float last(static_cast<float>(side_ - 1));
  const auto clamped = [&](Float cells) {
    return xsimd::min(xsimd::max(cells - Float(0.5F), Float(0.F)), last);
  };
  const Float x = clamped(raster_x * Float(cells_per_x_));
  const Float y = clamped(raster_y * Float(cells_per_y_));
  const Int column = truncate(x), row = truncate(y);
  const Float across = x - to_float(column), down = y - to_float(row);
  const Int right = select(less(column, Int(side_ - 1)), column + Int(1), column);
  const Int below = select(less(row, Int(side_ - 1)), row + Int(1), row);
  const auto value = [&](Int r, Int c) {
    return gather(values_.data(), r * Int(side_) + c, lanes);
  };
  const Float upper = value(row, column) * (Float(1.F) - across) + value(row, right) * across;
  const Float lower = value(below, column) * (Float(1.F) - across) + value(below, right) * across;
  return Float(1.F) / (upper * (Float(1.F) - down) + lower * down);
}

void LightMap::add(float raster_x, float raster_y, float luminance) {
  const auto cell = [](float position, int pixels) {
    const float at = position * static_cast<float>(kSide) / static_cast<float>(pixels);
    return static_cast<size_t>(std::clamp(at, 0.F, static_cast<float>(kSide - 1)));
  };
  sums_[cell(raster_y, height_) * kSide + cell(raster_x, width_)] += luminance;
}

}  // namespace metrofarm::work_unit
