// `metrofarm-worker bench`: what the renderer does without the service around it.
#pragma once

#include "app/arguments.h"

namespace metrofarm::app {

// Renders in-process and prints one JSON object of figures. Returns the exit code.
int run_bench(const std::vector<std::string>& words);

}  // namespace metrofarm::app
