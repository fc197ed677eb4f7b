// Reading numbers from text without locale and without exceptions.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace metrofarm::scene_file {

std::string_view trim(std::string_view text);

// The whole text must be one number; surrounding white space and a leading '+' are allowed.
// Infinity and NaN are not numbers here.
std::optional<double> parse_double(std::string_view text);
std::optional<int64_t> parse_integer(std::string_view text);

// Parts between commas and white space, as Mitsuba separates vector components.
std::vector<std::string_view> split_list(std::string_view text);

// Numbers of a list such as "1, 2 3"; nothing if a part is not a number.
std::optional<std::vector<double>> parse_doubles(std::string_view text);

}  // namespace metrofarm::scene_file
