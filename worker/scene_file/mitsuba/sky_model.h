// Radiance of a clear sky and of its sun (Hosek and Wilkie 2012, 2013), in coordinates with z
// towards the zenith.
#pragma once

#include <array>

#include "scene_file/affine.h"

namespace metrofarm::scene_file::mitsuba {

inline constexpr double kSunApertureDegrees = 0.5358;  // as seen from the earth

struct DateAndPlace {
  int64_t year = 2010, month = 7, day = 10;
  double hour = 15, minute = 0, second = 0;
  double latitude_degrees = 35.6894, longitude_degrees = 139.6917;
  double timezone = 9;  // hours ahead of universal time
};

struct SunPosition {
  double zenith_angle = 0;  // radians
  double azimuth = 0;       // radians from north towards east
};

// The algorithm PSA (Blanco-Muriel et al. 2001, "Computing the solar vector").
SunPosition sun_position(const DateAndPlace& when);

class SkyModel {
 public:
  // turbidity: 1 to 10; albedo: of the ground, 0 to 1. Requires: the sun is not below the horizon.
  SkyModel(double turbidity, const std::array<float, 3>& albedo, const Point& to_sun);

  // Of a unit direction above the horizon.
  std::array<double, 3> sky_radiance(const Point& direction) const;

  // Mean over the disk of the sun in its natural size.
  std::array<double, 3> sun_radiance() const;

 private:
  double turbidity_;
  Point to_sun_;
  double elevation_;                             // radians
  std::array<std::array<double, 9>, 3> shapes_;  // per channel
  std::array<double, 3> radiances_;
};

}  // namespace metrofarm::scene_file::mitsuba
