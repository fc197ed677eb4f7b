// `metrofarm-worker files SCENE.xml`: the files that a scene is made of, one per line.
#pragma once

#include <string>
#include <vector>

namespace metrofarm::app {

// Returns the exit code.
int run_files(const std::vector<std::string>& words);

}  // namespace metrofarm::app
