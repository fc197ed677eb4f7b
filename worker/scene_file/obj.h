// Wavefront OBJ: the geometry of a file as one mesh.
#pragma once

#include <string>
#include <string_view>

#include "base/result.h"
#include "scene_file/mesh.h"

namespace metrofarm::scene_file {

// Reads v, vt, vn and f (polygons, negative indices); groups, materials, lines and points are
// skipped. Corners with equal position, texture and normal indices share a vertex; vertices are in
// the order of their first use. Errors name file_name and the line.
Result<RawMesh> parse_obj(std::string_view text, const std::string& file_name);

}  // namespace metrofarm::scene_file
