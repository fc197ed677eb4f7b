// Materials that scene files name instead of giving numbers.
#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "scene/description.h"

namespace metrofarm::scene_file {

struct ConductorIndex {
  scene::Rgb eta;
  scene::Rgb k;
};

// By Mitsuba's names ("Au", "Cu", ...; "none" reflects everything).
std::optional<ConductorIndex> find_conductor(std::string_view name);
std::vector<std::string_view> conductor_names();

// Index of refraction of a dielectric, by Mitsuba's names in any case ("bk7", "air", ...).
std::optional<double> find_ior(std::string_view name);
std::vector<std::string_view> ior_names();

}  // namespace metrofarm::scene_file
