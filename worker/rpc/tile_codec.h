// The wire form of film tiles: byte-shuffled values in a zstd frame. See metrofarm.farm.v1.Tile.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace metrofarm::rpc {

std::string encode_tile(std::span<const int64_t> values);

}  // namespace metrofarm::rpc
