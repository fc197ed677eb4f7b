// `metrofarm-worker inspect SCENE`: what is in a scene, as JSON (metrofarm.scene.v1.SceneReport).
#pragma once

#include <string>
#include <vector>

namespace metrofarm::app {

// Returns the exit code.
int run_inspect(const std::vector<std::string>& words);

}  // namespace metrofarm::app
