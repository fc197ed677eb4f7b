// Stanford PLY, ascii and binary.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/result.h"
#include "scene_file/mesh.h"

namespace metrofarm::scene_file {

// Reads vertex x y z, optional nx ny nz and u v (or s t), face vertex_indices (vertex_index) and
// the attributes of both (ply_attributes.h); everything else is skipped. Errors name file_name and,
// for the header and ascii bodies, the line. A mesh of more than max_bytes is refused.
Result<RawMesh> parse_ply(std::string_view file, const std::string& file_name, uint64_t max_bytes);

}  // namespace metrofarm::scene_file
