// A sealed film and the segments in it, ready to be delivered.
#pragma once

#include <vector>

#include "film/film.h"
#include "metrofarm/farm/v1/farm_service.pb.h"

namespace metrofarm::rpc {

struct Batch {
  farm::v1::BatchHeader header;
  // Tiles in messages of bounded size.
  std::vector<farm::v1::DeliverTiles> tiles;
};

// Encodes a film's non-empty tiles on `threads` threads. The header has its segments already;
// tile_count and digest are filled in here. Requires: nobody splats meanwhile.
Batch seal(farm::v1::BatchHeader header, const film::Film& film, int threads);

}  // namespace metrofarm::rpc
