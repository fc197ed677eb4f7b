// When light reaches the film: from when to when, how much of it, and which row when.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "math/lanes.h"
#include "motion/track.h"

namespace metrofarm::sensor {

// Efficiency over the time from open to close: 1 throughout; rising, 1, falling; as a table says.
enum class ShutterCurve { kBox, kTrapezoid, kTabulated };
// What a film value is: the mean radiance, weighted by the efficiency; or the radiance times the
// efficiency, integrated over the time in seconds.
enum class Exposure { kNormalized, kCamera };

// See metrofarm.job.v1.ResolvedSpec.
struct ShutterSettings {
  double open = 0;   // seconds
  double close = 0;  // not before open
  ShutterCurve curve = ShutterCurve::kBox;
  std::vector<double> samples = {};      // kTabulated
  double ramp_open = 0, ramp_close = 0;  // kTrapezoid: shares of the time
  Exposure exposure = Exposure::kNormalized;
  double rolling = 0;  // seconds by which the last row is later than the first
};

inline constexpr size_t kMostShutterSamples = 1024;

// What is wrong with the settings, empty if nothing is.
std::string problem_with(const ShutterSettings& settings);

// Immutable; thread-safe.
class Shutter {
 public:
  // height: rows of the image. Requires: nothing is wrong with the settings.
  Shutter(const ShutterSettings& settings, int height);

  // While the shutter is open for some row.
  const motion::Interval& interval() const { return interval_; }
  // Film value over mean radiance.
  float exposure() const { return exposure_; }
  // Rows have times of their own.
  bool rolls() const { return lag_ != 0; }

  // A time at which the row at `raster_y` (pixels) is exposed, in proportion to the efficiency, by
  // inversion of its integral: in [0, 1], from interval().begin to its end. u: uniform.
  Float time(Float u, Float raster_y) const;

  // The density of such times at `time`, over what it is on average for raster_y uniform in
  // [first_y, first_y + height]. Requires: such rows are exposed then.
  Float row_weight(Float time, Float raster_y, Float first_y, Float height) const;

 private:
  Float share_of(Float u) const;
  Float row_lag(Float raster_y) const;
  Float density(Float share) const;
  Float integral(Float share) const;
  Int knot_below(const std::vector<float>& table, Float value) const;

  motion::Interval interval_;
  float exposure_ = 1;
  // The efficiency is linear between knots; here scaled to an integral of 1 over shares of the time
  // from open to close.
  std::vector<float> knots_;       // shares, from 0 to 1, growing
  std::vector<float> efficiency_;  // at the knots
  std::vector<float> integral_;    // up to the knots, from 0 to 1
  float width_ = 1;                // of that time, in shares of the interval
  float start_ = 0;                // of it for the first row, likewise
  float lag_ = 0;                  // of the last row, likewise
  float rows_ = 1;
};

}  // namespace metrofarm::sensor
