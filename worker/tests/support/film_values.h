// Reads films and recomputes their digest from the planes, as the contract of BatchHeader words it.
#pragma once

#include <cstdint>
#include <vector>

#include "film/film.h"

namespace metrofarm::test {

// Values of a full plane, [pixel][channel].
inline std::vector<int64_t> full_plane(const film::Film& film, int plane) {
  const film::FilmShape& shape = film.shape();
  constexpr int kTile = film::kTileSize;
  std::vector<int64_t> out(shape.pixels() * film::kChannels);
  std::vector<int64_t> tile(size_t{kTile} * kTile * film::kChannels);
  for (int ty = 0; ty < film.tiles_y(); ++ty) {
    for (int tx = 0; tx < film.tiles_x(); ++tx) {
      film.read_tile(plane, tx, ty, tile.data());
      for (int i = 0; i < kTile * kTile * film::kChannels; ++i) {
        const int channel = i / (kTile * kTile);
        const int x = tx * kTile + i % kTile;
        const int y = ty * kTile + i / kTile % kTile;
        if (x < shape.width && y < shape.height)
          out[(size_t(y) * shape.width + x) * film::kChannels + channel] = tile[i];
      }
    }
  }
  return out;
}

// Values of a low plane, channel by channel.
inline std::vector<int64_t> low_plane(const film::Film& film, int plane) {
  std::vector<int64_t> out(size_t{film::kLowGrid} * film::kLowGrid * film::kChannels);
  film.read_low(plane, out.data());
  return out;
}

inline std::vector<int64_t> all_values(const film::Film& film) {
  std::vector<int64_t> out;
  const auto append = [&](const std::vector<int64_t>& v) {
    out.insert(out.end(), v.begin(), v.end());
  };
  for (int p = 0; p < film.shape().full_planes(); ++p) append(full_plane(film, p));
  for (int p = 0; p < film.shape().low_planes(); ++p) append(low_plane(film, p));
  return out;
}

// The finalizer of SplitMix64 applied to (x + 1) * 0x9e3779b97f4a7c15, with the lowest bit set.
inline uint64_t odd_mix(uint64_t x) {
  uint64_t z = (x + 1) * 0x9e3779b97f4a7c15ULL;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ z >> 27) * 0x94d049bb133111ebULL;
  return (z ^ z >> 31) | 1;
}

inline uint64_t digest_from_planes(const film::Film& film) {
  const uint64_t two48 = uint64_t{1} << 48, two32 = uint64_t{1} << 32;
  uint64_t digest = 0;
  for (int p = 0; p < film.shape().full_planes(); ++p) {
    const std::vector<int64_t> values = full_plane(film, p);
    for (size_t i = 0; i < values.size(); ++i)
      digest += uint64_t(values[i]) * odd_mix(i / 3) * odd_mix(two48 + 3 * uint64_t(p) + i % 3);
  }
  for (int p = 0; p < film.shape().low_planes(); ++p) {
    const std::vector<int64_t> values = low_plane(film, p);
    constexpr size_t kCells = size_t{film::kLowGrid} * film::kLowGrid;
    for (size_t i = 0; i < values.size(); ++i)
      digest += uint64_t(values[i]) * odd_mix(two32 + i % kCells) *
                odd_mix(two48 + 3 * (128 + uint64_t(p)) + i / kCells);
  }
  return digest;
}

// Sum of all values of one channel of a full plane, in units.
inline double sum_of(const film::Film& film, int plane, int channel) {
  const std::vector<int64_t> values = full_plane(film, plane);
  double sum = 0;
  for (size_t i = channel; i < values.size(); i += film::kChannels) sum += double(values[i]);
  return sum / film::kFixedOne;
}

}  // namespace metrofarm::test
