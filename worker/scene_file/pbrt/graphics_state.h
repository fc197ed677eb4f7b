// What directives change for those after them: transforms and attributes.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "scene_file/pbrt/lights.h"
#include "scene_file/pbrt/materials.h"
#include "scene_file/pbrt/parameters.h"

namespace metrofarm::scene_file::pbrt {

// The current transform at the start and at the end of the shutter's interval.
using TransformPair = std::array<Matrix, 2>;

struct GraphicsState {
  TransformPair transform = {kIdentity, kIdentity};
  std::array<bool, 2> active = {true, true};  // which of them directives change
  bool reverse_orientation = false;
  Materials::Use material = 0;
  std::shared_ptr<const AreaLight> area_light;  // nullptr: shapes are no lights
  ColourSpace colour_space = ColourSpace::kSrgb;
  // Parameters of Attribute directives, by target ("shape", "light", ...).
  std::map<std::string, std::vector<Parameter>, std::less<>> defaults;
};

// Saved states, with what opened them.
struct SavedState {
  GraphicsState state;
  std::string opened_by;  // "AttributeBegin", "TransformBegin", "ObjectBegin"
  SourceLocation where;
};

}  // namespace metrofarm::scene_file::pbrt
