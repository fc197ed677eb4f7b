// `metrofarm-worker --coordinator HOST:PORT`: renders for a coordinator.
#pragma once

#include <string>
#include <vector>

namespace metrofarm::app {

// Returns the exit code.
int run_serve(const std::vector<std::string>& words);

}  // namespace metrofarm::app
