// Values in PLY files beyond positions, normals and texture coordinates, under Mitsuba's names.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "scene_file/ply_header.h"

namespace metrofarm::scene_file {

struct PlyAttribute {
  std::string name;                // "vertex_color", "face_temperature", ...
  std::vector<size_t> properties;  // 1 or 3 of the element, in the order of the channels
  float scale = 1;                 // of the stored numbers: colours in integers are fractions
};

// r g b (or red green blue) are the attribute "color"; NAME_a, or NAME_a NAME_b NAME_c, are the
// attribute NAME. Others are left out. prefix: "vertex_" or "face_".
std::vector<PlyAttribute> find_attributes(const PlyElement& element, std::string_view prefix);

}  // namespace metrofarm::scene_file
