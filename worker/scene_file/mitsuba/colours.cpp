#include "scene_file/mitsuba/colours.h"

#include <charconv>
#include <cmath>

#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Rgb;

// The linear sRGB coordinates of XYZ = (1, 1, 1): what Mitsuba's RGB variants make of an emitter
// whose spectrum is constant. For reflectances and indices a constant stays grey.
constexpr Rgb kEqualEnergyWhite = {1.204794F, 0.948291F, 0.908916F};

constexpr Rgb grey(double value) {
  const auto v = static_cast<float>(value);
  return {v, v, v};
}

float srgb_to_linear(double encoded) {
  return static_cast<float>(encoded <= 0.04045 ? encoded / 12.92
                                               : std::pow((encoded + 0.055) / 1.055, 2.4));
}

std::optional<Rgb> parse_hex(std::string_view text) {
  if (text.size() != 7) return std::nullopt;
  uint32_t bits = 0;
  const auto [end, error] = std::from_chars(text.data() + 1, text.data() + 7, bits, 16);
  if (error != std::errc() || end != text.data() + 7) return std::nullopt;
  return Rgb{srgb_to_linear((bits >> 16 & 255) / 255.0), srgb_to_linear((bits >> 8 & 255) / 255.0),
             srgb_to_linear((bits & 255) / 255.0)};
}

std::optional<Rgb> parse_rgb(std::string_view text) {
  text = trim(text);
  if (text.starts_with('#')) return parse_hex(text);
  const auto values = parse_doubles(text);
  if (!values || (values->size() != 1 && values->size() != 3)) return std::nullopt;
  return Rgb{static_cast<float>((*values)[0]), static_cast<float>((*values)[values->size() / 2]),
             static_cast<float>(values->back())};
}

Rgb read_rgb(const Element& element, const Rgb& fallback, Problems& problems) {
  const std::optional<Rgb> colour = parse_rgb(element.get("value"));
  if (!colour) {
    problems.fail("\"" + element.get("value") +
                      "\" is not a colour: expected \"r, g, b\", one number or \"#rrggbb\"",
                  element.where);
    return fallback;
  }
  if (element.tag != "srgb" || trim(element.get("value")).starts_with('#')) return *colour;
  return {srgb_to_linear((*colour)[0]), srgb_to_linear((*colour)[1]), srgb_to_linear((*colour)[2])};
}

Rgb read_spectrum(const Element& element, const Rgb& fallback, ColourUse use, Problems& problems) {
  // Mitsuba 0.6 takes three values for a colour.
  if (element.legacy && split_list(element.get("value")).size() == 3 &&
      element.get("value").find(':') == std::string::npos) {
    return read_rgb(element, fallback, problems);
  }
  const std::optional<double> value = parse_double(element.get("value"));
  if (!value) {
    problems.unsupported(
        "spectra of wavelength:value pairs, from files or of other kinds are not "
        "supported yet; give an <rgb> or a constant <spectrum value=\"...\"/>",
        element.where);
    return fallback;
  }
  Rgb colour = grey(*value);
  if (use == ColourUse::kEmission) {
    for (int i = 0; i < 3; ++i) colour[i] = static_cast<float>(*value * kEqualEnergyWhite[i]);
  }
  return colour;
}

Rgb read_element(const Element& element, const Rgb& fallback, ColourUse use, Properties& properties,
                 std::string_view name) {
  Problems& problems = properties.problems();
  if (element.tag == "rgb" || element.tag == "srgb") return read_rgb(element, fallback, problems);
  if (element.tag == "spectrum") return read_spectrum(element, fallback, use, problems);
  if (element.tag == "float" || element.tag == "integer") {
    return grey(properties.number(name, fallback[0]));
  }
  problems.unsupported("parameter \"" + std::string(name) + "\" of " +
                           properties.element().describe() +
                           " must be an <rgb>, <spectrum> or <float>; " + element.describe() +
                           " is not supported here" +
                           (problems.lenient() ? "; the default colour takes its place" : ""),
                       element.where);
  return fallback;
}

}  // namespace

Rgb read_colour(Properties& properties, std::string_view name, const Rgb& fallback, ColourUse use) {
  const Element* element = properties.find(name);
  if (!element) return fallback;
  const Rgb colour = read_element(*element, fallback, use, properties, name);
  for (float component : colour) {
    const bool valid = std::isfinite(component) && component >= 0 &&
                       (use != ColourUse::kReflectance || component <= 1);
    if (valid) continue;
    properties.problems().fail(
        "colour \"" + std::string(name) + "\" of " + properties.element().describe() + " must be " +
            (use == ColourUse::kReflectance ? "between 0 and 1" : "finite and not negative"),
        element->where);
    return fallback;
  }
  return colour;
}

}  // namespace metrofarm::scene_file::mitsuba
