// Light from all directions, as a latitude-longitude image gives it.
//
// The image is looked up as Mitsuba 3.9 does: column i is centred at u = (i + 1/2) / width and
// wraps round, row j lies at v = j / (height - 1), so the first and last row are the poles;
// bilinear in between. u = atan2(x, -z) / 2 pi and v = acos(y) / pi of the map's own space.
#pragma once

#include <array>
#include <vector>

#include "emitter/light_sample.h"
#include "scene/description.h"
#include "texture/images.h"

namespace metrofarm::emitter {

// Immutable; thread-safe.
class EnvironmentMap {
 public:
  // images: outlives this. Requires: to_world is invertible.
  EnvironmentMap(const scene::EnvironmentEmitter& emitter, const texture::Images& images);

  // direction: unit, away from the scene.
  Spectrum radiance(const Vec3& direction, Mask lanes) const;
  // Of the directions that sample() gives: bilinear between pixels as the radiance is, but in
  // latitudes linear in their cosine. Above zero wherever there is radiance, however little.
  Float pdf_solid_angle(const Vec3& direction, Mask lanes) const;
  // A unit direction. Requires: mean_weight() > 0. A step of u is a small step of the direction
  // unless it leaves a dark part of the map.
  Vec3 sample(Vec2 u, Mask lanes) const;

  // weight_of() the radiance, averaged over the sphere.
  double mean_weight() const { return mean_weight_; }
  uint64_t bytes() const;

 private:
  // Four neighbouring pixels and a place between them.
  struct Cell {
    Int column, next_column, row, next_row;
  };
  struct Place {
    Cell cell;
    Float across;  // fraction of the way to the next column
    Float down;    // fraction of the angle to the next row
    Float drop;    // fraction of the cosine to the next row
  };
  struct Corners {
    Spectrum upper, upper_next, lower, lower_next;
  };
  // Half of 1 - cos and of 1 + cos of the polar angle: sines and cosines from the smaller one of
  // them keep their digits at both poles.
  struct Latitude {
    Float from_top, from_bottom;
  };

  void measure_rows();
  void build_tables();
  double add_row(const std::vector<float>& upper, const std::vector<float>& lower, int row);
  Float pick_of_column(const Cell& cell, Mask lanes) const;
  void weigh_row(int row, std::vector<float>& weights) const;
  Cell cell_at(Int column, Int row) const;
  Place place_of(const Vec3& local, Mask lanes) const;
  Corners corners(const Cell& cell, Mask lanes) const;
  Float fraction_of_cosine(const Latitude& at, Int row, Mask lanes) const;

  const texture::Images& images_;
  scene::Index image_;
  float scale_;
  int width_, height_;
  int rows_;                         // of cells: one less than of pixels, but at least one
  std::array<float, 9> to_world_{};  // row major; turns only
  std::array<float, 9> to_local_{};
  std::vector<float> from_top_;  // Latitude::from_top at the upper edge of each row of cells, and
  std::vector<float> from_bottom_;  // at the lower edge of the last
  std::vector<float> row_cdf_;      // upper end of each row's part of [0, 1)
  std::vector<float> column_cdf_;   // width_ per row: the same within the row
  std::vector<float> pdf_of_row_;   // pdf_solid_angle of the row over width_, all columns alike
  double mean_weight_ = 0;
};

}  // namespace metrofarm::emitter
