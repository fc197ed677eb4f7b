#include "scene_file/spectra.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "scene_file/cie1931.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file {
namespace {

// Mitsuba integrates with this many points, the ends included.
constexpr int kIntegrationPoints = 1000;

// The integral of the colour matching function y over wavelengths in nm.
constexpr double kYIntegral = 106.857;

CieRow cie_at(double wavelength) {
  const double position = (wavelength - kCieFirst) / kCieStep;
  const int row = std::clamp(static_cast<int>(position), 0, kCieRows - 2);
  const double t = position - row;
  const CieRow& a = kCieTable[row];
  const CieRow& b = kCieTable[row + 1];
  return {std::lerp(a.x, b.x, t), std::lerp(a.y, b.y, t), std::lerp(a.z, b.z, t),
          std::lerp(a.d65, b.d65, t)};
}

double value_at(const Spectrum& spectrum, double wavelength) {
  const std::vector<double>& points = spectrum.wavelengths;
  if (wavelength < points.front() || wavelength > points.back()) return 0;
  const auto above = std::upper_bound(points.begin() + 1, points.end() - 1, wavelength);
  const auto i = static_cast<size_t>(above - points.begin());
  const double t = (wavelength - points[i - 1]) / (points[i] - points[i - 1]);
  return std::lerp(spectrum.values[i - 1], spectrum.values[i], t);
}

// ITU-R Rec. BT.709 primaries with white point D65.
scene::Rgb xyz_to_rgb(double x, double y, double z) {
  return {static_cast<float>(3.240479 * x - 1.537150 * y - 0.498535 * z),
          static_cast<float>(-0.969256 * x + 1.875991 * y + 0.041556 * z),
          static_cast<float>(0.055648 * x - 0.204043 * y + 1.057311 * z)};
}

std::string number_text(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

ParsedSpectrum wrong(std::string problem, int line = 0) {
  return {std::nullopt, std::move(problem), line};
}

}  // namespace

scene::Rgb spectrum_to_rgb(const Spectrum& spectrum, Illuminant illuminant) {
  constexpr double kSpacing = (kCieLast - kCieFirst) / (kIntegrationPoints - 1);
  double x = 0;
  double y = 0;
  double z = 0;
  for (int i = 0; i < kIntegrationPoints; ++i) {
    const double wavelength = kCieFirst + i * kSpacing;
    const CieRow cie = cie_at(wavelength);
    const double seen =
        value_at(spectrum, wavelength) * (illuminant == Illuminant::kD65 ? cie.d65 : 1);
    x += cie.x * seen;
    y += cie.y * seen;
    z += cie.z * seen;
  }
  constexpr double kScale = kSpacing / kYIntegral;
  return xyz_to_rgb(x * kScale, y * kScale, z * kScale);
}

Spectrum black_body(double temperature) {
  constexpr double kPlanck = 6.62607004e-34;     // J s
  constexpr double kLight = 2.99792458e8;        // m / s
  constexpr double kBoltzmann = 1.38064852e-23;  // J / K
  constexpr double kNanometre = 1e-9;
  Spectrum spectrum;
  for (int step = 0; step <= static_cast<int>(kCieLast - kCieFirst); ++step) {
    const double wavelength = kCieFirst + step;
    const double metres = wavelength * kNanometre;
    const double exponent = kPlanck * kLight / (metres * kBoltzmann * temperature);
    const double per_metre =
        2 * kPlanck * kLight * kLight / (std::pow(metres, 5) * std::expm1(exponent));
    spectrum.wavelengths.push_back(wavelength);
    spectrum.values.push_back(per_metre * kNanometre);
  }
  return spectrum;
}

ParsedSpectrum make_spectrum(std::vector<double> wavelengths, std::vector<double> values) {
  if (wavelengths.size() != values.size()) {
    return wrong("a spectrum needs as many values as wavelengths, not " +
                 std::to_string(values.size()) + " for " + std::to_string(wavelengths.size()));
  }
  if (wavelengths.size() < 2) return wrong("a spectrum needs at least two wavelengths");
  for (size_t i = 1; i < wavelengths.size(); ++i) {
    if (wavelengths[i] > wavelengths[i - 1]) continue;
    return wrong("the wavelengths of a spectrum must grow, but " + number_text(wavelengths[i]) +
                 " follows " + number_text(wavelengths[i - 1]));
  }
  return {Spectrum{std::move(wavelengths), std::move(values)}};
}

ParsedSpectrum parse_spectrum_pairs(std::string_view text) {
  std::vector<double> wavelengths;
  std::vector<double> values;
  for (std::string_view pair : split_list(text)) {
    const size_t colon = pair.find(':');
    const auto wavelength = parse_double(pair.substr(0, colon));
    const auto value =
        colon == std::string_view::npos ? std::nullopt : parse_double(pair.substr(colon + 1));
    if (!wavelength || !value) {
      return wrong("\"" + std::string(pair) +
                   "\" is not a pair of wavelength and value as in \"400:0.5, 700:0.6\"");
    }
    wavelengths.push_back(*wavelength);
    values.push_back(*value);
  }
  return make_spectrum(std::move(wavelengths), std::move(values));
}

ParsedSpectrum parse_spectrum_file(std::string_view text) {
  std::vector<double> wavelengths;
  std::vector<double> values;
  for (int line = 1; !text.empty(); ++line) {
    const size_t end = std::min(text.find('\n'), text.size());
    const std::string_view content = trim(text.substr(0, std::min(text.find('#'), end)));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (content.empty()) continue;
    const auto numbers = parse_doubles(content);
    if (!numbers || numbers->size() != 2) {
      return wrong(
          "\"" + std::string(content.substr(0, 40)) + "\" must be a wavelength in nm and a value",
          line);
    }
    wavelengths.push_back((*numbers)[0]);
    values.push_back((*numbers)[1]);
  }
  return make_spectrum(std::move(wavelengths), std::move(values));
}

}  // namespace metrofarm::scene_file
