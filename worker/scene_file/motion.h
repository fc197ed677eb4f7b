// Poses between the keys of an animation.
#pragma once

#include <optional>
#include <vector>

#include "scene_file/affine.h"

namespace metrofarm::scene_file {

// The pose at a time: the first key's before the first, the last key's after the last. In between,
// each key is a stretch S (symmetric), then a rotation R (perhaps with a mirror), then a
// translation T: T and S go linearly from key to key, R along the shorter arc at constant speed
// (Shoemake and Duff 1992, "Matrix Animation and Polar Decomposition"). Nothing if a key that is
// needed for this has no such parts, as it flattens space.
// Requires: at least one key, times grow.
std::optional<Matrix> pose_at(const std::vector<scene::Keyframe>& keys, double time);

}  // namespace metrofarm::scene_file
