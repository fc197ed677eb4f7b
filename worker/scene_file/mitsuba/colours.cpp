#include "scene_file/mitsuba/colours.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "scene_file/numbers.h"
#include "scene_file/spectra.h"
#include "spectrum/srgb.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

using scene::Rgb;

constexpr Rgb kGrey = {0.5F, 0.5F, 0.5F};  // after a problem

// The linear sRGB coordinates of XYZ = (1, 1, 1): what Mitsuba's RGB variants make of an emitter
// whose spectrum is constant. For reflectances and indices a constant stays grey.
constexpr Rgb kEqualEnergyWhite = {1.204794F, 0.948291F, 0.908916F};

constexpr Rgb grey(double value) {
  const auto v = static_cast<float>(value);
  return {v, v, v};
}

Rgb scaled(const Rgb& colour, double factor) {
  return {static_cast<float>(colour[0] * factor), static_cast<float>(colour[1] * factor),
          static_cast<float>(colour[2] * factor)};
}

float linear_of(double encoded) {
  return static_cast<float>(srgb_to_linear(encoded));
}

std::optional<Rgb> parse_hex(std::string_view text) {
  if (text.size() != 7) return std::nullopt;
  uint32_t bits = 0;
  const auto [end, error] = std::from_chars(text.data() + 1, text.data() + 7, bits, 16);
  if (error != std::errc() || end != text.data() + 7) return std::nullopt;
  return Rgb{linear_of((bits >> 16 & 255) / 255.0), linear_of((bits >> 8 & 255) / 255.0),
             linear_of((bits & 255) / 255.0)};
}

std::optional<Rgb> parse_rgb(std::string_view text) {
  text = trim(text);
  if (text.starts_with('#')) return parse_hex(text);
  const auto values = parse_doubles(text);
  if (!values || (values->size() != 1 && values->size() != 3)) return std::nullopt;
  return Rgb{static_cast<float>((*values)[0]), static_cast<float>((*values)[values->size() / 2]),
             static_cast<float>(values->back())};
}

Rgb load_rgb(const Element& element, Problems& problems) {
  const std::optional<Rgb> colour = parse_rgb(element.get("value"));
  if (!colour) {
    problems.fail("\"" + element.get("value") +
                      "\" is not a colour: expected \"r, g, b\", one number or \"#rrggbb\"",
                  element.where);
    return kGrey;
  }
  if (element.tag != "srgb" || trim(element.get("value")).starts_with('#')) return *colour;
  return {linear_of((*colour)[0]), linear_of((*colour)[1]), linear_of((*colour)[2])};
}

// Negative components, and for reflectances those above 1, are moved to the bounds: no colour of
// the renderer's is as saturated as the spectrum. Mitsuba does the same.
Rgb into_gamut(const Rgb& colour, const Element& element, ColourUse use, Problems& problems) {
  const float highest = use == ColourUse::kReflectance ? 1 : std::numeric_limits<float>::max();
  Rgb inside;
  for (int i = 0; i < 3; ++i) inside[i] = std::clamp(colour[i], 0.0F, highest);
  if (inside != colour) {
    problems.warn(
        "the colour of this spectrum lies outside the gamut of linear Rec. 709 RGB; the "
        "nearest values inside take its place",
        element.where);
  }
  return inside;
}

// file: where the spectrum was read from if it is not in the element itself.
Rgb colour_of(const ParsedSpectrum& parsed, const Element& element, ColourUse use,
              Problems& problems, const std::string& file = "") {
  if (!parsed.spectrum) {
    problems.fail(parsed.problem, file.empty() ? element.where : SourceLocation{file, parsed.line});
    return kGrey;
  }
  const Illuminant illuminant =
      use == ColourUse::kEmission ? Illuminant::kEqualEnergy : Illuminant::kD65;
  return into_gamut(spectrum_to_rgb(*parsed.spectrum, illuminant), element, use, problems);
}

Rgb load_spectrum_file(const Element& element, ColourUse use, Context& context) {
  const auto path = context.files.find(element.get("filename"));
  const auto bytes = path ? context.files.read(path.value()) : Result<FileBytes>(path.error());
  if (!bytes) {
    context.problems.fail(bytes.error().message, element.where);
    return kGrey;
  }
  return colour_of(parse_spectrum_file(*bytes.value()), element, use, context.problems,
                   path.value().string());
}

Rgb load_spectrum(const Element& element, ColourUse use, Context& context) {
  if (element.find("filename")) return load_spectrum_file(element, use, context);
  const std::string& text = element.get("value");
  if (text.find(':') != std::string::npos) {
    return colour_of(parse_spectrum_pairs(text), element, use, context.problems);
  }
  // Mitsuba 0.6 takes three values for a colour.
  if (element.legacy && split_list(text).size() == 3) return load_rgb(element, context.problems);
  const std::optional<double> value = parse_double(text);
  if (!value) {
    context.problems.fail("\"" + text +
                              "\" is not a spectrum: expected one number or \"wavelength:value, "
                              "...\"; a colour is written <rgb value=\"r, g, b\"/>",
                          element.where);
    return kGrey;
  }
  return use == ColourUse::kEmission ? scaled(kEqualEnergyWhite, *value) : grey(*value);
}

Rgb load_number(const Element& element, Problems& problems) {
  const std::optional<double> value = parse_double(element.get("value"));
  if (!value) {
    problems.fail("\"" + element.get("value") + "\" is not a number (attribute \"value\" of <" +
                      element.tag + ">)",
                  element.where);
  }
  return grey(value.value_or(0.5));
}

// ---- spectrum plugins ----

Rgb black_body_colour(double temperature, const Element& element, ColourUse use,
                      Problems& problems) {
  constexpr double kHottest = 1e6;
  if (!(temperature > 0 && temperature <= kHottest)) {
    problems.fail("the temperature of a black body must be between 0 and 1000000 kelvin",
                  element.where);
    return kGrey;
  }
  return colour_of({black_body(temperature)}, element, use, problems);
}

// Mitsuba 0.6: <blackbody temperature="5000K" scale="2"/>.
Rgb load_black_body_tag(const Element& element, ColourUse use, Problems& problems) {
  std::string_view text = trim(element.get("temperature"));
  if (text.ends_with('K') || text.ends_with('k')) text.remove_suffix(1);
  const std::optional<double> temperature = parse_double(text);
  const std::optional<double> scale =
      element.find("scale") ? parse_double(element.get("scale")) : 1.0;
  if (!temperature || !scale) {
    problems.fail("<blackbody> needs a temperature as in \"5000K\", and a number as its scale",
                  element.where);
    return kGrey;
  }
  return scaled(black_body_colour(*temperature, element, use, problems), *scale);
}

Rgb load_black_body(Properties& properties, ColourUse use, Context& context) {
  const double scale = properties.number("scale", 1);
  properties.ignore({"wavelength_min", "wavelength_max"});
  if (!properties.has("temperature")) {
    context.problems.fail("spectrum \"blackbody\" needs a temperature in kelvin",
                          properties.element().where);
    return kGrey;
  }
  return scaled(black_body_colour(properties.number("temperature", 0), properties.element(), use,
                                  context.problems),
                scale);
}

Rgb load_d65(Properties& properties, ColourUse use, Context& context) {
  const double scale = properties.number("scale", 1);
  return scaled(read_colour(properties, "color", {1, 1, 1}, use, context), scale);
}

Rgb load_uniform(Properties& properties, ColourUse, Context&) {
  return grey(properties.number("value", 1));
}

Rgb load_srgb(Properties& properties, ColourUse use, Context& context) {
  return read_colour(properties, "color", kGrey, use, context);
}

Rgb load_raw(Properties& properties, ColourUse, Context&) {
  const Element* value = properties.find("value");
  if (!value || (value->tag != "vector" && value->tag != "point")) {
    return grey(properties.number("value", 1));
  }
  const Point p = properties.point("value", {1, 1, 1});
  return {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
}

std::vector<double> read_list(Properties& properties, std::string_view name) {
  const auto list = parse_doubles(properties.text(name, ""));
  if (!list) {
    properties.problems().fail(
        "parameter \"" + std::string(name) + "\" must be numbers between commas, as in \"1, 2, 3\"",
        properties.find(name)->where);
  }
  return list.value_or(std::vector<double>());
}

Rgb load_irregular(Properties& properties, ColourUse use, Context& context) {
  return colour_of(
      make_spectrum(read_list(properties, "wavelengths"), read_list(properties, "values")),
      properties.element(), use, context.problems);
}

Rgb load_regular(Properties& properties, ColourUse use, Context& context) {
  const double first = properties.number("wavelength_min", 360);
  const double last = properties.number("wavelength_max", 830);
  std::vector<double> values = read_list(properties, "values");
  std::vector<double> wavelengths;
  for (size_t i = 0; i < values.size(); ++i) {
    wavelengths.push_back(first + (last - first) * static_cast<double>(i) /
                                      static_cast<double>(std::max<size_t>(values.size() - 1, 1)));
  }
  return colour_of(make_spectrum(std::move(wavelengths), std::move(values)), properties.element(),
                   use, context.problems);
}

constexpr Plugin<Rgb (*)(Properties&, ColourUse, Context&)> kSpectra[] = {
    {"blackbody", load_black_body}, {"d65", load_d65},
    {"uniform", load_uniform},      {"srgb", load_srgb},
    {"rawconstant", load_raw},      {"irregular", load_irregular},
    {"regular", load_regular},
};

Rgb load_element(const Element& element, ColourUse use, Context& context) {
  if (element.tag == "rgb" || element.tag == "srgb") return load_rgb(element, context.problems);
  if (element.tag == "blackbody") return load_black_body_tag(element, use, context.problems);
  if (element.tag == "float" || element.tag == "integer") {
    return load_number(element, context.problems);
  }
  if (!element.find("type")) return load_spectrum(element, use, context);
  const auto* plugin = find_plugin(kSpectra, element, "it is left out", context.problems);
  if (!plugin) return kGrey;
  constexpr size_t kMaxNesting = 16;
  if (context.textures_in_progress.size() >= kMaxNesting ||
      !context.textures_in_progress.insert(&element).second) {
    context.problems.fail(element.describe() + " is nested too deeply or contains itself",
                          element.where);
    return kGrey;
  }
  Properties properties = context.properties_of(element);
  const Rgb colour = plugin->load(properties, use, context);
  properties.finish();
  context.textures_in_progress.erase(&element);
  return colour;
}

}  // namespace

bool is_colour(const Element& element) {
  for (std::string_view tag : {"rgb", "srgb", "float", "integer", "blackbody"}) {
    if (element.tag == tag) return true;
  }
  if (element.tag != "spectrum" && element.tag != "texture") return false;
  const std::string* type = element.find("type");
  if (!type) return element.tag == "spectrum";
  return std::any_of(std::begin(kSpectra), std::end(kSpectra),
                     [&](const auto& plugin) { return plugin.type == *type; });
}

Rgb load_colour(const Element& element, std::string_view what, ColourUse use, Context& context) {
  const Rgb colour = load_element(element, use, context);
  for (float component : colour) {
    const bool valid = std::isfinite(component) && component >= 0 &&
                       (use != ColourUse::kReflectance || component <= 1);
    if (valid) continue;
    context.problems.fail(
        std::string(what) + " must be " +
            (use == ColourUse::kReflectance ? "between 0 and 1" : "finite and not negative"),
        element.where);
    return kGrey;
  }
  return colour;
}

Rgb read_colour(Properties& properties, std::string_view name, const Rgb& fallback, ColourUse use,
                Context& context) {
  const Element* element = properties.find(name);
  if (!element) return fallback;
  const std::string owner = " of " + properties.element().describe();
  if (is_colour(*element)) {
    return load_colour(*element, "colour \"" + std::string(name) + "\"" + owner, use, context);
  }
  context.problems.unsupported(
      "parameter \"" + std::string(name) + "\"" + owner +
          " must be an <rgb>, <spectrum> or <float>; " + element->describe() +
          " is not supported here" +
          (context.problems.lenient() ? "; the default colour takes its place" : ""),
      element->where);
  return fallback;
}

std::vector<std::string_view> spectrum_types() {
  std::vector<std::string_view> types;
  for (const auto& plugin : kSpectra) types.push_back(plugin.type);
  return types;
}

}  // namespace metrofarm::scene_file::mitsuba
