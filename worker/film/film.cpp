#include "film/film.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "math/rng.h"

namespace metrofarm::film {
namespace {

constexpr int kLowPlaneOffset = 128;

uint64_t pixel_hash(uint64_t index) {
  return mix64(index) | 1;
}
uint64_t plane_hash(int plane, int channel) {
  return mix64((uint64_t{1} << 48) + uint64_t(3 * plane + channel)) | 1;
}

uint64_t add_and_digest(int64_t* target, const int64_t v[kChannels], const uint64_t* hashes) {
  uint64_t sum = 0;
  for (int c = 0; c < kChannels; ++c) {
    if (v[c] == 0) continue;
    std::atomic_ref<int64_t>(target[c]).fetch_add(v[c], std::memory_order_relaxed);
    sum += static_cast<uint64_t>(v[c]) * hashes[c];
  }
  return sum;
}

// Rounds v to fixed point so that the expectation over the dither is exact.
int64_t to_fixed(double v, double dither) {
  return static_cast<int64_t>(std::floor(v * kFixedOne + dither));
}

// 21 bits of noise for each channel.
double dither_of(uint64_t noise, int channel) {
  return static_cast<double>(noise >> (21 * channel) & 0x1fffffU) * 0x1p-21;
}

}  // namespace

Film::Film(const FilmShape& shape)
    : shape_(shape),
      cell_width_((shape.width + kLowGrid - 1) / kLowGrid),
      cell_height_((shape.height + kLowGrid - 1) / kLowGrid),
      full_(shape.pixels() * kChannels * shape.full_planes()),
      low_(size_t{kLowGrid} * kLowGrid * kChannels * shape.low_planes()) {
  for (int p = 0; p < shape.full_planes(); ++p)
    for (int c = 0; c < kChannels; ++c) full_hash_.push_back(plane_hash(p, c));
  for (int p = 0; p < shape.low_planes(); ++p)
    for (int c = 0; c < kChannels; ++c) low_hash_.push_back(plane_hash(kLowPlaneOffset + p, c));
}

uint64_t Film::bytes(const FilmShape& shape) {
  return shape.pixels() * kChannels * shape.full_planes() * sizeof(int64_t);
}

uint64_t Film::add_full(int plane, size_t pixel, const int64_t v[kChannels]) {
  int64_t* target = &full_[(plane * shape_.pixels() + pixel) * kChannels];
  return pixel_hash(pixel) * add_and_digest(target, v, &full_hash_[size_t(plane) * kChannels]);
}

uint64_t Film::add_low(int plane, size_t cell, const int64_t v[kChannels]) {
  constexpr size_t kCells = size_t{kLowGrid} * kLowGrid;
  int64_t* target = &low_[(plane * kCells + cell) * kChannels];
  return pixel_hash((uint64_t{1} << 32) + cell) *
         add_and_digest(target, v, &low_hash_[size_t(plane) * kChannels]);
}

bool Film::read_tile(int plane, int tile_x, int tile_y, int64_t* out) const {
  const int x0 = tile_x * kTileSize, y0 = tile_y * kTileSize;
  const int x1 = std::min(x0 + kTileSize, shape_.width);
  const int y1 = std::min(y0 + kTileSize, shape_.height);
  std::fill_n(out, kTileSize * kTileSize * kChannels, 0);
  bool any = false;
  for (int y = y0; y < y1; ++y) {
    const int64_t* row = &full_[(plane * shape_.pixels() + size_t(y) * shape_.width) * kChannels];
    for (int x = x0; x < x1; ++x) {
      for (int c = 0; c < kChannels; ++c) {
        const int64_t v = row[size_t(x) * kChannels + c];
        out[(c * kTileSize + (y - y0)) * kTileSize + (x - x0)] = v;
        any = any || v != 0;
      }
    }
  }
  return any;
}

bool Film::read_low(int plane, int64_t* out) const {
  constexpr size_t kCells = size_t{kLowGrid} * kLowGrid;
  bool any = false;
  for (size_t cell = 0; cell < kCells; ++cell) {
    for (int c = 0; c < kChannels; ++c) {
      const int64_t v = low_[(plane * kCells + cell) * kChannels + c];
      out[c * kCells + cell] = v;
      any = any || v != 0;
    }
  }
  return any;
}

uint64_t Film::largest_magnitude() const {
  int64_t lowest = 0, highest = 0;
  for (const std::vector<int64_t>* values : {&full_, &low_}) {
    const auto [low, high] = std::minmax_element(values->begin(), values->end());
    lowest = std::min(lowest, *low);
    highest = std::max(highest, *high);
  }
  return std::max(static_cast<uint64_t>(highest), uint64_t{0} - static_cast<uint64_t>(lowest));
}

void Film::clear() {
  std::fill(full_.begin(), full_.end(), 0);
  std::fill(low_.begin(), low_.end(), 0);
}

void Splatter::add_pixel(const Destination& to, int x, int y, const double rgb[kChannels],
                         uint64_t noise) {
  const FilmShape& shape = film_.shape();
  const size_t pixel = size_t(y) * shape.width + x;
  const uint64_t here = mix64(noise ^ pixel);
  int64_t v[kChannels];
  for (int c = 0; c < kChannels; ++c) v[c] = to_fixed(rgb[c], dither_of(here, c));
  digest_ += film_.add_full(to.half * shape.layers + to.layer, pixel, v);
}

void Splatter::count(const Destination& to, float x, float y, const int64_t v[kChannels]) {
  const FilmShape& shape = film_.shape();
  const int px = static_cast<int>(std::floor(x)), py = static_cast<int>(std::floor(y));
  if (px < 0 || py < 0 || px >= shape.width || py >= shape.height) return;
  digest_ += film_.add_low(to.group * shape.layers + to.layer, film_.low_cell(px, py), v);
  digest_ += film_.add_full(to.half * shape.layers + to.layer, size_t(py) * shape.width + px, v);
}

void Splatter::splat(const Destination& to, float x, float y, const float rgb[kChannels],
                     uint64_t noise) {
  const FilmShape& shape = film_.shape();
  const double value[kChannels] = {rgb[0], rgb[1], rgb[2]};
  // The statistics need no filter: each splat counts once, in the cell it falls into.
  const int px = static_cast<int>(std::floor(x)), py = static_cast<int>(std::floor(y));
  const bool inside = px >= 0 && py >= 0 && px < shape.width && py < shape.height;
  if (inside) {
    int64_t v[kChannels];
    for (int c = 0; c < kChannels; ++c) v[c] = to_fixed(value[c], dither_of(noise, c));
    digest_ += film_.add_low(to.group * shape.layers + to.layer, film_.low_cell(px, py), v);
  }
  if (filter_.is_pixel_box()) {
    // A coordinate can round up to the film's very edge.
    add_pixel(to, std::clamp(px, 0, shape.width - 1), std::clamp(py, 0, shape.height - 1), value,
              noise);
    return;
  }
  const Filter::Span columns = filter_.span(x), rows = filter_.span(y);
  for (int j = 0; j < rows.count; ++j) {
    const int row = rows.first + j;
    if (row < 0 || row >= shape.height) continue;
    for (int i = 0; i < columns.count; ++i) {
      const int column = columns.first + i;
      if (column < 0 || column >= shape.width) continue;
      const double w = double(rows.weight[j]) * columns.weight[i];
      if (w == 0) continue;
      const double weighted[kChannels] = {w * value[0], w * value[1], w * value[2]};
      add_pixel(to, column, row, weighted, noise);
    }
  }
}

}  // namespace metrofarm::film
