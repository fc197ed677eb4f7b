#include "scene_file/mitsuba/sky_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene_file/mitsuba/sky_tables.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kTurbidities = 10;
constexpr int kControlPoints = 6;
constexpr int kCoefficients = 9;
constexpr int kSunElevations = 24;

double radians(double degrees) {
  return degrees * (kPi / 180);
}

// Linear interpolation between the tabulated turbidities.
struct Blend {
  int lower;
  double fraction;
};

Blend blend_of(double position, int count) {
  const int lower = std::clamp(static_cast<int>(position), 0, count - 2);
  return {lower, position - lower};
}

// Quintic Bezier curve over the cube root of the elevation.
template <class At>
double bezier(double x, const At& at) {
  constexpr double kBinomials[kControlPoints] = {1, 5, 10, 10, 5, 1};
  double sum = 0;
  for (int i = 0; i < kControlPoints; ++i) {
    sum += kBinomials[i] * std::pow(x, i) * std::pow(1 - x, kControlPoints - 1 - i) * at(i);
  }
  return sum;
}

// Index of a control point in kSkyRadiances.
int cell(int turbidity, int albedo, int point, int channel) {
  return ((turbidity * 2 + albedo) * kControlPoints + point) * 3 + channel;
}

// Days since noon of 1 January 2000, universal time. The calendar is the Gregorian one.
double days_since_2000(const DateAndPlace& when, double universal_hours) {
  const int64_t m = (when.month - 14) / 12;
  const int64_t julian_day = 1461 * (when.year + 4800 + m) / 4 +
                             367 * (when.month - 2 - 12 * m) / 12 -
                             3 * ((when.year + 4900 + m) / 100) / 4 + when.day - 32075;
  return static_cast<double>(julian_day) - 0.5 + universal_hours / 24 - 2451545.0;
}

}  // namespace

SunPosition sun_position(const DateAndPlace& when) {
  const double hours = when.hour - when.timezone + (when.minute + when.second / 60) / 60;
  const double days = days_since_2000(when, hours);
  const double omega = 2.1429 - 0.0010394594 * days;
  const double mean_longitude = 4.8950630 + 0.017202791698 * days;
  const double anomaly = 6.2400600 + 0.0172019699 * days;
  const double longitude = mean_longitude + 0.03341607 * std::sin(anomaly) +
                           0.00034894 * std::sin(2 * anomaly) - 0.0001134 -
                           0.0000203 * std::sin(omega);
  const double obliquity = 0.4090928 - 6.2140e-9 * days + 0.0000396 * std::cos(omega);
  const double ascension =
      std::atan2(std::cos(obliquity) * std::sin(longitude), std::cos(longitude));
  const double declination = std::asin(std::sin(obliquity) * std::sin(longitude));
  const double sidereal_hours = 6.6974243242 + 0.0657098283 * days + hours;
  const double hour_angle = radians(sidereal_hours * 15 + when.longitude_degrees) - ascension;
  const double latitude = radians(when.latitude_degrees);
  SunPosition sun;
  sun.zenith_angle = std::acos(std::cos(latitude) * std::cos(hour_angle) * std::cos(declination) +
                               std::sin(declination) * std::sin(latitude));
  sun.azimuth = std::atan2(-std::sin(hour_angle), std::tan(declination) * std::cos(latitude) -
                                                      std::sin(latitude) * std::cos(hour_angle));
  constexpr double kParallax = 6371.01 / 149597890;  // earth's radius over the sun's distance
  sun.zenith_angle += kParallax * std::sin(sun.zenith_angle);
  return sun;
}

SkyModel::SkyModel(double turbidity, const std::array<float, 3>& albedo, const Point& to_sun)
    : turbidity_(turbidity),
      to_sun_(to_sun),
      elevation_(std::asin(std::clamp(to_sun[2], 0.0, 1.0))) {
  const double x = std::cbrt(elevation_ / (kPi / 2));
  const Blend haze = blend_of(turbidity - 1, kTurbidities);
  for (int channel = 0; channel < 3; ++channel) {
    const double ground = albedo[channel];
    // Of a table's entry at cell c, interpolated in elevation, albedo and turbidity.
    const auto interpolate = [&](const auto& value_at) {
      double sum = 0;
      for (int corner = 0; corner < 4; ++corner) {
        const int t = corner & 1;
        const int a = corner >> 1;
        const double weight = (t ? haze.fraction : 1 - haze.fraction) * (a ? ground : 1 - ground);
        sum += weight *
               bezier(x, [&](int i) { return value_at(cell(haze.lower + t, a, i, channel)); });
      }
      return sum;
    };
    radiances_[channel] = interpolate([](int c) { return double{kSkyRadiances[c]}; });
    for (int k = 0; k < kCoefficients; ++k) {
      shapes_[channel][k] =
          interpolate([k](int c) { return double{kSkyShapes[c * kCoefficients + k]}; });
    }
  }
}

// Hosek and Wilkie 2012, equation 8; the published tables hold H after I.
std::array<double, 3> SkyModel::sky_radiance(const Point& direction) const {
  const double cos_theta = std::max(direction[2], 0.0);
  const double cos_gamma = std::clamp(dot(direction, to_sun_), -1.0, 1.0);
  const double gamma = std::acos(cos_gamma);
  std::array<double, 3> radiance;
  for (int channel = 0; channel < 3; ++channel) {
    const std::array<double, 9>& c = shapes_[channel];
    const double aureole =
        (1 + cos_gamma * cos_gamma) / std::pow(1 + c[8] * c[8] - 2 * c[8] * cos_gamma, 1.5);
    const double value = (1 + c[0] * std::exp(c[1] / (cos_theta + 0.01))) *
                         (c[2] + c[3] * std::exp(c[4] * gamma) + c[5] * cos_gamma * cos_gamma +
                          c[6] * aureole + c[7] * std::sqrt(cos_theta));
    radiance[channel] = std::max(value * radiances_[channel], 0.0);
  }
  return radiance;
}

std::array<double, 3> SkyModel::sun_radiance() const {
  const double position = std::sqrt(elevation_ / (kPi / 2)) * (kSunElevations - 1);
  const Blend height = blend_of(position, kSunElevations);
  const Blend haze = blend_of(turbidity_ - 1, kTurbidities);
  std::array<double, 3> radiance = {0, 0, 0};
  for (int corner = 0; corner < 4; ++corner) {
    const int t = corner & 1;
    const int h = corner >> 1;
    const double weight =
        (t ? haze.fraction : 1 - haze.fraction) * (h ? height.fraction : 1 - height.fraction);
    for (int channel = 0; channel < 3; ++channel) {
      const int row = (haze.lower + t) * kSunElevations + height.lower + h;
      radiance[channel] += weight * kSunRadiances[3 * row + channel];
    }
  }
  return radiance;
}

}  // namespace metrofarm::scene_file::mitsuba
