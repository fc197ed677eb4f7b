// The film: exact sums of splats in 64-bit fixed point.
//
// A splat of value v adds floor(v 2^32 + dither) with dither uniform in [0, 1), so that its
// expectation is v 2^32. Addition is modulo 2^64 and never saturates: merging films depends on no
// order, thread or retry. See metrofarm.farm.v1.BatchHeader for the planes and the digest.
#pragma once

#include <cstdint>
#include <vector>

#include "film/filter.h"

namespace metrofarm::film {

inline constexpr int kHalves = 2;
inline constexpr int kStatisticsGroups = 16;
inline constexpr int kLowGrid = 16;  // cells per axis of a low-resolution plane
inline constexpr int kTileSize = 32;
inline constexpr int kChannels = 3;
inline constexpr double kFixedOne = 0x1p32;

struct FilmShape {
  int width = 0;
  int height = 0;
  int layers = 1;

  size_t pixels() const { return size_t(width) * height; }
  int full_planes() const { return kHalves * layers; }
  int low_planes() const { return kStatisticsGroups * layers; }
};

// Which planes a splat goes to.
struct Destination {
  int layer = 0;
  int half = 0;
  int group = 0;  // statistics group
};

// Thread safety: any number of threads may splat at once; reading requires that none does.
class Film {
 public:
  explicit Film(const FilmShape& shape);

  const FilmShape& shape() const { return shape_; }

  // Adds v to a pixel (full plane) or cell (low plane) and returns its share of the digest.
  uint64_t add_full(int plane, size_t pixel, const int64_t v[kChannels]);
  uint64_t add_low(int plane, size_t cell, const int64_t v[kChannels]);
  size_t low_cell(int x, int y) const {
    return size_t(y / cell_height_) * kLowGrid + x / cell_width_;
  }

  // Values of one 32 x 32 tile, channel by channel, zero outside the image. False: all zero.
  bool read_tile(int plane, int tile_x, int tile_y, int64_t* out) const;
  // Values of a low plane, channel by channel. False: all zero.
  bool read_low(int plane, int64_t* out) const;
  int tiles_x() const { return (shape_.width + kTileSize - 1) / kTileSize; }
  int tiles_y() const { return (shape_.height + kTileSize - 1) / kTileSize; }

  // Of any value. Requires: nobody splats meanwhile.
  uint64_t largest_magnitude() const;
  void clear();
  static uint64_t bytes(const FilmShape& shape);

 private:
  FilmShape shape_;
  int cell_width_, cell_height_;
  std::vector<int64_t> full_;                   // [plane][pixel][channel]
  std::vector<int64_t> low_;                    // [plane][cell][channel]
  std::vector<uint64_t> full_hash_, low_hash_;  // plane_hash(plane, channel)
};

// Spreads contributions over the film for one segment and keeps the segment's linear digest.
class Splatter {
 public:
  Splatter(Film& film, const Filter& filter) : film_(film), filter_(filter) {}

  // Adds scale * rgb at a raster position. noise: 64 random bits of this splat, for the dither.
  void splat(const Destination& to, float x, float y, const float rgb[kChannels], uint64_t noise);

  // Adds v, in fixed point and without the filter, to the pixel that holds a raster position; none
  // does outside the image.
  void count(const Destination& to, float x, float y, const int64_t v[kChannels]);

  uint64_t digest() const { return digest_; }
  void reset_digest() { digest_ = 0; }

 private:
  void add_pixel(const Destination& to, int x, int y, const double rgb[kChannels], uint64_t noise);

  Film& film_;
  const Filter& filter_;
  uint64_t digest_ = 0;
};

}  // namespace metrofarm::film
