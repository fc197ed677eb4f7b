#include "scene_file/pbrt/colours.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "scene_file/names.h"
#include "scene_file/pbrt/spectra.h"
#include "scene_file/spectra.h"
#include "spectrum/luminance.h"

namespace metrofarm::scene_file::pbrt {
namespace {

enum class Use { kReflectance, kEmission, kIndex };

bool valid(const Rgb& rgb) {
  return std::all_of(rgb.begin(), rgb.end(), [](float c) { return std::isfinite(c) && c >= 0; });
}

// From the primaries of the list to Rec. 709; both whites are D65, so white stays white.
Rgb convert_primaries(const Rgb& c, ColourSpace space) {
  constexpr double kRec2020[3][3] = {{1.660491, -0.587641, -0.072850},
                                     {-0.124550, 1.132900, -0.008349},
                                     {-0.018151, -0.100579, 1.118730}};
  constexpr double kDciP3[3][3] = {
      {1.224940, -0.224940, 0}, {-0.042057, 1.042057, 0}, {-0.019638, -0.078636, 1.098274}};
  if (space == ColourSpace::kSrgb) return c;
  const auto& m = space == ColourSpace::kRec2020 ? kRec2020 : kDciP3;
  Rgb result{};
  for (size_t row = 0; row < 3; ++row) {
    const double value = m[row][0] * c[0] + m[row][1] * c[1] + m[row][2] * c[2];
    result[row] = static_cast<float>(std::max(value, 0.0));
  }
  return result;
}

Rgb scaled(const Rgb& rgb, double factor) {
  Rgb result{};
  for (size_t i = 0; i < 3; ++i) result[i] = static_cast<float>(rgb[i] * factor);
  return result;
}

Rgb without_negative_parts(const Rgb& rgb) {
  return {std::max(rgb[0], 0.0F), std::max(rgb[1], 0.0F), std::max(rgb[2], 0.0F)};
}

Rgb rgb_of(const Spectrum& spectrum, Use use) {
  const auto light = use == Use::kEmission ? Illuminant::kEqualEnergy : Illuminant::kD65;
  return without_negative_parts(spectrum_to_rgb(spectrum, light));
}

class ColourReader {
 public:
  ColourReader(const Parameter& parameter, Use use, ColourSpace space, Context& context)
      : parameter_(parameter), use_(use), space_(space), context_(context) {}

  Rgb read() {
    const Rgb rgb = read_any();
    if (context_.problems.failed()) return {0, 0, 0};
    if (!valid(rgb)) return fail("must not be negative");
    if (use_ == Use::kReflectance && *std::max_element(rgb.begin(), rgb.end()) > 1) {
      context_.problems.warn("\"" + parameter_.name +
                                 "\" is greater than 1: more light comes back "
                                 "than arrives; it is limited to 1, as pbrt does",
                             parameter_.where);
      return {std::min(rgb[0], 1.0F), std::min(rgb[1], 1.0F), std::min(rgb[2], 1.0F)};
    }
    return rgb;
  }

 private:
  Rgb fail(const std::string& what) {
    context_.problems.fail("\"" + parameter_.name + "\" " + what, parameter_.where);
    return {0, 0, 0};
  }

  Rgb read_any() {
    switch (parameter_.type) {
      case ParameterType::kRgb:
        return read_rgb();
      case ParameterType::kBlackbody:
        return read_blackbody();
      case ParameterType::kSpectrum:
        return parameter_.strings.empty() ? read_pairs(parameter_.numbers) : read_named();
      case ParameterType::kFloat:
        if (use_ != Use::kEmission && parameter_.numbers.size() == 1) {
          const auto value = static_cast<float>(parameter_.numbers[0]);
          return {value, value, value};
        }
        [[fallthrough]];
      default:
        return fail("must be given as rgb, spectrum or blackbody");
    }
  }

  Rgb read_rgb() {
    if (parameter_.numbers.size() != 3) return fail("must have three numbers");
    Rgb rgb{};
    for (size_t i = 0; i < 3; ++i) rgb[i] = static_cast<float>(parameter_.numbers[i]);
    return use_ == Use::kIndex ? rgb : convert_primaries(rgb, space_);
  }

  Rgb read_blackbody() {
    if (parameter_.numbers.size() != 1) {
      return fail(
          "must have one number, the temperature in kelvin (pbrt-v3's factor is now the "
          "light's \"scale\")");
    }
    if (!(parameter_.numbers[0] > 0)) return fail("must be a temperature greater than 0 kelvin");
    return rgb_of(black_body(parameter_.numbers[0]), use_);
  }

  Rgb read_pairs(const std::vector<double>& pairs) {
    std::vector<double> wavelengths;
    std::vector<double> values;
    for (size_t i = 0; i < pairs.size(); ++i) (i % 2 ? values : wavelengths).push_back(pairs[i]);
    if (wavelengths.size() != values.size()) {
      return fail("must be pairs of a wavelength in nanometres and a value, or a name in quotes");
    }
    return read_parsed(make_spectrum(std::move(wavelengths), std::move(values)));
  }

  Rgb read_parsed(const ParsedSpectrum& parsed) {
    if (!parsed.spectrum) return fail("is not a spectrum: " + parsed.problem);
    return rgb_of(*parsed.spectrum, use_);
  }

  Rgb read_named() {
    const std::string& name = parameter_.strings[0];
    if (parameter_.strings.size() != 1) return fail("must be one name");
    if (const std::optional<Rgb> index = find_index(name)) return *index;
    if (const std::optional<Rgb> light = find_illuminant(name)) return *light;
    if (name.ends_with(".spd")) return read_file(name);
    return fail("names the unknown spectrum \"" + name + "\"" + suggestion(name, spectrum_names()));
  }

  Rgb read_file(const std::string& name) {
    const FileBytes bytes = read_named_file(name, parameter_.where, context_);
    return bytes ? read_parsed(parse_spectrum_file(*bytes)) : Rgb{0, 0, 0};
  }

  const Parameter& parameter_;
  Use use_;
  ColourSpace space_;
  Context& context_;
};

}  // namespace

Rgb read_reflectance(Parameters& parameters, std::string_view name, const Rgb& fallback,
                     Context& context) {
  const Parameter* parameter = parameters.find(name);
  if (!parameter) return fallback;
  return ColourReader(*parameter, Use::kReflectance, parameters.colour_space(), context).read();
}

Rgb read_emission(Parameters& parameters, std::string_view name, Context& context) {
  const Parameter* parameter = parameters.find(name);
  if (!parameter) return {1, 1, 1};
  const Rgb rgb =
      ColourReader(*parameter, Use::kEmission, parameters.colour_space(), context).read();
  const bool is_rgb = parameter->type == ParameterType::kRgb;
  if (is_rgb || !(luminance(rgb.data()) > 0)) return rgb;
  return scaled(rgb, 1.0 / luminance(rgb.data()));
}

std::optional<Rgb> read_index(Parameters& parameters, std::string_view name, Context& context) {
  const Parameter* parameter = parameters.find(name);
  if (!parameter) return std::nullopt;
  return ColourReader(*parameter, Use::kIndex, parameters.colour_space(), context).read();
}

}  // namespace metrofarm::scene_file::pbrt
