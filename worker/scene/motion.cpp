#include <algorithm>

#include "scene/description.h"

namespace metrofarm::scene {

bool has_motion(const SceneDescription& scene) {
  const auto moves = [](const auto& element) { return !element.motion.empty(); };
  const auto deforms = [](const Shape& shape) { return !shape.key_times.empty(); };
  return std::any_of(scene.shapes.begin(), scene.shapes.end(), moves) ||
         std::any_of(scene.shapes.begin(), scene.shapes.end(), deforms) ||
         std::any_of(scene.instances.begin(), scene.instances.end(), moves) ||
         std::any_of(scene.emitters.begin(), scene.emitters.end(), moves);
}

}  // namespace metrofarm::scene
