// Names in scene files: comparing them, and saying which known one an unknown one is nearest to.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace metrofarm::scene_file {

std::string lower_case(std::string_view text);

// "toWorld" -> "to_world", "intIOR" -> "int_ior"; names already in snake case are unchanged.
std::string snake_case(std::string_view text);

// What to add to "unknown name": `; did you mean "x"?` where a candidate is close, then the list of
// what is supported (shortened if it is long). Empty if there are no candidates.
std::string suggestion(std::string_view name, const std::vector<std::string_view>& candidates);

}  // namespace metrofarm::scene_file
