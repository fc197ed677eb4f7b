#include "scene_file/pbrt/spectra.h"

#include <algorithm>
#include <string>

#include "scene_file/named_materials.h"

namespace metrofarm::scene_file::pbrt {
namespace {

struct Illuminant {
  std::string_view name;
  double x, y;  // chromaticity (CIE 15:2004, tables T.3 and T.8.1)
};

constexpr auto kIlluminants = std::to_array<Illuminant>({
    {"stdillum-A", 0.44758, 0.40745},
    {"stdillum-D50", 0.34567, 0.35851},
    {"stdillum-D65", 0.31272, 0.32903},
    {"stdillum-F1", 0.3131, 0.3371},
    {"stdillum-F2", 0.3721, 0.3751},
    {"stdillum-F3", 0.4091, 0.3941},
    {"stdillum-F4", 0.4402, 0.4031},
    {"stdillum-F5", 0.3138, 0.3452},
    {"stdillum-F6", 0.3779, 0.3882},
    {"stdillum-F7", 0.3129, 0.3292},
    {"stdillum-F8", 0.3458, 0.3586},
    {"stdillum-F9", 0.3741, 0.3727},
    {"stdillum-F10", 0.3458, 0.3588},
    {"stdillum-F11", 0.3805, 0.3769},
    {"stdillum-F12", 0.4370, 0.4042},
    {"illum-acesD60", 0.32168, 0.33767},
});

struct Metal {
  std::string_view eta, k;
  std::string_view conductor;  // in the table of conductors
};

constexpr auto kMetals = std::to_array<Metal>({
    {"metal-Ag-eta", "metal-Ag-k", "Ag"},
    {"metal-Al-eta", "metal-Al-k", "Al"},
    {"metal-Au-eta", "metal-Au-k", "Au"},
    {"metal-Cu-eta", "metal-Cu-k", "Cu"},
    {"metal-MgO-eta", "metal-MgO-k", "MgO"},
    {"metal-TiO2-eta", "metal-TiO2-k", "TiO2"},
    {"metal-CuZn-eta", "metal-CuZn-k", ""},  // brass
});

// Brass at about 630, 532 and 465 nm (Querry 1985).
constexpr Rgb kBrassEta = {0.4441F, 0.5272F, 1.0932F};
constexpr Rgb kBrassK = {3.6950F, 2.7652F, 1.8291F};

struct Glass {
  std::string_view name;
  float index;  // at 587.6 nm (Schott's catalogue)
};

constexpr auto kGlasses = std::to_array<Glass>({{"glass-BK7", 1.5168F},
                                                {"glass-BAF10", 1.67003F},
                                                {"glass-FK51A", 1.48656F},
                                                {"glass-LASF9", 1.85025F},
                                                {"glass-F5", 1.60342F},
                                                {"glass-SF5", 1.67271F},
                                                {"glass-F10", 1.72825F},
                                                {"glass-SF10", 1.72825F},
                                                {"glass-F11", 1.78472F},
                                                {"glass-SF11", 1.78472F}});

// IEC 61966-2-1, without adaptation: D65 gives equal channels. Colours outside the gamut lose their
// negative part.
Rgb xyz_to_rgb(const std::array<double, 3>& c) {
  const std::array<double, 3> rgb = {3.2404542 * c[0] - 1.5371385 * c[1] - 0.4985314 * c[2],
                                     -0.9692660 * c[0] + 1.8760108 * c[1] + 0.0415560 * c[2],
                                     0.0556434 * c[0] - 0.2040259 * c[1] + 1.0572252 * c[2]};
  Rgb result{};
  for (size_t i = 0; i < 3; ++i) result[i] = static_cast<float>(std::max(rgb[i], 0.0));
  return result;
}

}  // namespace

std::optional<Rgb> find_illuminant(std::string_view name) {
  for (const Illuminant& light : kIlluminants) {
    if (light.name == name) {
      return xyz_to_rgb({light.x / light.y, 1, (1 - light.x - light.y) / light.y});
    }
  }
  return std::nullopt;
}

std::optional<Rgb> find_index(std::string_view name) {
  for (const Glass& glass : kGlasses) {
    if (glass.name == name) return Rgb{glass.index, glass.index, glass.index};
  }
  for (const Metal& metal : kMetals) {
    const bool is_eta = metal.eta == name;
    if (!is_eta && metal.k != name) continue;
    const auto conductor = find_conductor(metal.conductor);
    if (!conductor) return is_eta ? kBrassEta : kBrassK;
    return is_eta ? conductor->eta : conductor->k;
  }
  return std::nullopt;
}

std::vector<std::string_view> spectrum_names() {
  std::vector<std::string_view> names;
  for (const Metal& metal : kMetals) names.insert(names.end(), {metal.eta, metal.k});
  for (const Glass& glass : kGlasses) names.push_back(glass.name);
  for (const Illuminant& light : kIlluminants) names.push_back(light.name);
  return names;
}

}  // namespace metrofarm::scene_file::pbrt
