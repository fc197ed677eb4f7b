// Mitsuba's binary .serialized meshes, versions 3 and 4: several zlib-compressed meshes in a file.
#pragma once

#include <cstdint>
#include <string_view>

#include "base/result.h"
#include "scene_file/mesh.h"

namespace metrofarm::scene_file {

// The mesh with the given index (from 0). Colours become the attribute
// vertex_color. A mesh of more than max_bytes is refused by its header. Errors have no location.
Result<RawMesh> parse_serialized(std::string_view file, int64_t shape_index, uint64_t max_bytes);

}  // namespace metrofarm::scene_file
