// Colours and spectra of pbrt as linear Rec. 709 RGB.
#pragma once

#include <optional>
#include <string_view>

#include "scene_file/pbrt/context.h"

namespace metrofarm::scene_file::pbrt {

using scene::Rgb;

// The colour of a surface whose reflectance is the parameter, seen under the light that is white in
// the film's colour space.
Rgb read_reflectance(Parameters& parameters, std::string_view name, const Rgb& fallback,
                     Context& context);

// The emission of a light before its "scale": rgb values are taken as they are; spectra are scaled
// to a luminance of 1, as pbrt-v4 does with all its lights.
Rgb read_emission(Parameters& parameters, std::string_view name, Context& context);

// A quantity per channel such as an index of refraction or an absorption coefficient. nullopt where
// the file doesn't have it.
std::optional<Rgb> read_index(Parameters& parameters, std::string_view name, Context& context);

}  // namespace metrofarm::scene_file::pbrt
