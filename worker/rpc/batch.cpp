#include "rpc/batch.h"

#include <optional>

#include "base/parallel.h"
#include "rpc/tile_codec.h"

namespace metrofarm::rpc {

using farm::v1::Tile;

namespace {

// Keeps each message well under 1 MiB.
constexpr size_t kMessageBytes = size_t{512} * 1024;

// All tiles of the film, empty ones as nullopt, in a fixed order.
std::vector<std::optional<Tile>> encode_all(const film::Film& film, int threads) {
  const int columns = film.tiles_x(), rows = film.tiles_y();
  const size_t per_plane = size_t(columns) * rows;
  const size_t full = per_plane * film.shape().full_planes();
  std::vector<std::optional<Tile>> tiles(full + film.shape().low_planes());
  parallel_for(tiles.size(), threads, [&](size_t i, int) {
    std::vector<int64_t> values(size_t{film::kTileSize} * film::kTileSize * film::kChannels);
    Tile tile;
    if (i < full) {
      tile.set_plane(static_cast<uint32_t>(i / per_plane));
      tile.set_x(static_cast<uint32_t>(i % per_plane % columns));
      tile.set_y(static_cast<uint32_t>(i % per_plane / columns));
      if (!film.read_tile(static_cast<int>(tile.plane()), static_cast<int>(tile.x()),
                          static_cast<int>(tile.y()), values.data()))
        return;
    } else {
      tile.set_low(true);
      tile.set_plane(static_cast<uint32_t>(i - full));
      values.resize(size_t{film::kLowGrid} * film::kLowGrid * film::kChannels);
      if (!film.read_low(static_cast<int>(tile.plane()), values.data())) return;
    }
    tile.set_data(encode_tile(values));
    tiles[i] = std::move(tile);
  });
  return tiles;
}

}  // namespace

Batch seal(farm::v1::BatchHeader header, const film::Film& film, int threads) {
  Batch batch;
  uint64_t digest = 0;
  for (const auto& segment : header.segments()) digest += segment.digest();
  uint32_t count = 0;
  size_t bytes = 0;
  for (std::optional<Tile>& tile : encode_all(film, threads)) {
    if (!tile) continue;
    if (batch.tiles.empty() || bytes > kMessageBytes) {
      batch.tiles.emplace_back();
      bytes = 0;
    }
    bytes += tile->data().size() + 32;
    *batch.tiles.back().add_tiles() = std::move(*tile);
    ++count;
  }
  batch.header = std::move(header);
  batch.header.set_digest(digest);
  batch.header.set_tile_count(count);
  return batch;
}

}  // namespace metrofarm::rpc
