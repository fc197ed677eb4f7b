// What must be alike for two workers to produce the same bits.
#pragma once

#include <string>
#include <string_view>

namespace metrofarm::work_unit {

// Hash of a fixed scene's rays and of the functions and approximations that differ between makers
// of processors and versions of libraries.
std::string probe_hash(std::string_view isa);

}  // namespace metrofarm::work_unit
