// `metrofarm-worker files SCENE`: the files that a scene is made of, one per line, and with a slash
// at the end the folders in which it has them looked for.
#pragma once

#include <string>
#include <vector>

namespace metrofarm::app {

// Returns the exit code.
int run_files(const std::vector<std::string>& words);

}  // namespace metrofarm::app
