// Spectra as linear Rec. 709 RGB, in the way of Mitsuba 3's RGB variants.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "scene/description.h"

namespace metrofarm::scene_file {

// Linear between its points and 0 outside them.
struct Spectrum {
  std::vector<double> wavelengths;  // nm, growing; at least two
  std::vector<double> values;       // one per wavelength
};

// What the spectrum is multiplied with before it is seen: reflectances and indices are looked at
// under daylight, lights are seen as they are.
enum class Illuminant { kD65, kEqualEnergy };

// The colour of the spectrum; components outside the gamut of Rec. 709 come out negative. A
// reflectance of 1 is white; an emission of 1 has luminance 1.
scene::Rgb spectrum_to_rgb(const Spectrum& spectrum, Illuminant illuminant);

// Planck's law: spectral radiance in W / (m^2 sr nm) over the visible wavelengths. Kelvin.
Spectrum black_body(double temperature);

// Either a spectrum or what is wrong.
struct ParsedSpectrum {
  std::optional<Spectrum> spectrum;
  std::string problem = {};
  int line = 0;  // of the text, from 1
};

// "400:0.1, 500:0.2, ...": pairs between commas or white space.
ParsedSpectrum parse_spectrum_pairs(std::string_view text);

// A .spd file: lines of wavelength and value; '#' begins a comment.
ParsedSpectrum parse_spectrum_file(std::string_view text);

// The points of two lists of the same length.
ParsedSpectrum make_spectrum(std::vector<double> wavelengths, std::vector<double> values);

}  // namespace metrofarm::scene_file
