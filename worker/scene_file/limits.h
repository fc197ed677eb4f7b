// What the renderer can't take, however well it is formed.
#pragma once

#include <optional>

#include "base/result.h"
#include "scene/description.h"

namespace metrofarm::scene_file {

// Embree leaves out what reaches further than 1.844e18 from the origin.
inline constexpr double kLargestCoordinate = 1.8e18;

// Errors, located at the shape or instance: more vertices, triangles, instances or lights than the
// renderer can number; coordinates beyond kLargestCoordinate.
std::optional<Error> check_limits(const scene::SceneDescription& scene);

}  // namespace metrofarm::scene_file
