// Spectra that pbrt knows by name, beside those that files spell out.
#pragma once

#include <array>
#include <optional>
#include <string_view>
#include <vector>

#include "scene/description.h"

namespace metrofarm::scene_file::pbrt {

using scene::Rgb;

// The colour, of luminance 1, of the CIE standard illuminants that pbrt names (stdillum-A,
// stdillum-F7, ...).
std::optional<Rgb> find_illuminant(std::string_view name);

// Complex index of refraction of metals ("metal-Cu-eta", "metal-Cu-k"), index of glasses
// ("glass-BK7", the same in all channels).
std::optional<Rgb> find_index(std::string_view name);

std::vector<std::string_view> spectrum_names();

}  // namespace metrofarm::scene_file::pbrt
