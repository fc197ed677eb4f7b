#include "sensor/shutter.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace metrofarm::sensor {
namespace {

struct Knot {
  double share, efficiency;
};

std::vector<Knot> knots_of(const ShutterSettings& s) {
  std::vector<Knot> knots;
  switch (s.curve) {
    case ShutterCurve::kBox:
      knots = {{0, 1}, {1, 1}};
      break;
    case ShutterCurve::kTrapezoid:
      knots = {{0, s.ramp_open > 0 ? 0.0 : 1.0}};
      if (s.ramp_open > 0) knots.push_back({s.ramp_open, 1});
      if (s.ramp_close > 0 && 1 - s.ramp_close > knots.back().share)
        knots.push_back({1 - s.ramp_close, 1});
      if (knots.back().share < 1) knots.push_back({1, s.ramp_close > 0 ? 0.0 : 1.0});
      break;
    case ShutterCurve::kTabulated:
      for (size_t i = 0; i < s.samples.size(); ++i)
        knots.push_back(
            {static_cast<double>(i) / static_cast<double>(s.samples.size() - 1), s.samples[i]});
      break;
  }
  return knots;
}

std::string problem_with_curve(const ShutterSettings& s) {
  const bool trapezoid = s.curve == ShutterCurve::kTrapezoid;
  if (!trapezoid && (s.ramp_open != 0 || s.ramp_close != 0))
    return "shutter_ramp_open and shutter_ramp_close must be 0 unless shutter_curve is trapezoid";
  if (!(s.ramp_open >= 0 && s.ramp_close >= 0 && s.ramp_open + s.ramp_close <= 1))
    return "shutter_ramp_open and shutter_ramp_close must not be negative, nor above 1 together";
  if (s.curve != ShutterCurve::kTabulated)
    return s.samples.empty() ? ""
                             : "shutter_samples must be empty unless shutter_curve is tabulated";
  if (s.samples.size() < 2 || s.samples.size() > kMostShutterSamples)
    return "shutter_samples must have 2 to 1024 values";
  double sum = 0;
  for (double v : s.samples) {
    if (!(v >= 0 && std::isfinite(v))) return "shutter_samples must be finite and not negative";
    sum += v;
  }
  if (!(sum > 0 && std::isfinite(sum))) return "shutter_samples must not all be 0";
  return "";
}

}  // namespace

std::string problem_with(const ShutterSettings& s) {
  if (!std::isfinite(s.open) || !std::isfinite(s.close) || !std::isfinite(s.close - s.open))
    return "shutter_open and shutter_close must be finite";
  if (!(s.close >= s.open)) return "shutter_close must not be before shutter_open";
  if (!std::isfinite(s.rolling)) return "rolling_shutter must be finite";
  const bool instant = s.close == s.open;
  if (instant && s.exposure == Exposure::kCamera)
    return "exposure camera needs a shutter_close later than shutter_open";
  if (instant && s.rolling != 0)
    return "rolling_shutter needs a shutter_close later than shutter_open";
  return problem_with_curve(s);
}

Shutter::Shutter(const ShutterSettings& s, int height)
    : interval_{s.open + std::min(0.0, s.rolling), s.close + std::max(0.0, s.rolling)},
      rows_(static_cast<float>(height)) {
  METROFARM_CHECK(problem_with(s).empty());
  const std::vector<Knot> knots = knots_of(s);
  double integral = 0;
  std::vector<double> integrals = {0};
  for (size_t i = 1; i < knots.size(); ++i) {
    integral += 0.5 * (knots[i].efficiency + knots[i - 1].efficiency) *
                (knots[i].share - knots[i - 1].share);
    integrals.push_back(integral);
  }
  METROFARM_CHECK(integral > 0);
  for (size_t i = 0; i < knots.size(); ++i) {
    knots_.push_back(static_cast<float>(knots[i].share));
    efficiency_.push_back(static_cast<float>(knots[i].efficiency / integral));
    integral_.push_back(static_cast<float>(integrals[i] / integral));
  }
  const double open_time = s.close - s.open;
  if (s.exposure == Exposure::kCamera) exposure_ = static_cast<float>(open_time * integral);
  if (s.rolling == 0 || height < 2) {
    interval_ = {s.open, s.close};
    return;
  }
  width_ = static_cast<float>(open_time / interval_.length());
  start_ = static_cast<float>((s.open - interval_.begin) / interval_.length());
  lag_ = static_cast<float>(s.rolling / interval_.length());
}

// The last knot whose entry is not above the value, but never the very last.
Int Shutter::knot_below(const std::vector<float>& table, Float value) const {
  auto left = static_cast<int32_t>(table.size()) - 1;
  Int first(0);
  while (left > 1) {
    const int32_t half = left / 2;
    const Int middle = first + Int(half);
    first = select(gather(table.data(), middle, all_lanes()) <= value, middle, first);
    left -= half;
  }
  return first;
}

Float Shutter::share_of(Float u) const {
  if (knots_.size() == 2 && efficiency_[0] == efficiency_[1]) return u;
  const Int i = knot_below(integral_, u), next = i + Int(1);
  const Mask all = all_lanes();
  const Float from = gather(knots_.data(), i, all), to = gather(knots_.data(), next, all);
  const Float e0 = gather(efficiency_.data(), i, all), e1 = gather(efficiency_.data(), next, all);
  const Float rest = xsimd::max(u - gather(integral_.data(), i, all), Float(0.F));
  // e0 s + (e1 - e0) s^2 / (2 (to - from)) = rest, without cancellation.
  const Float slope = (e1 - e0) / (to - from);
  const Float root = safe_sqrt(sqr(e0) + Float(2.F) * slope * rest);
  const Float denominator = e0 + root;
  const Float step = Float(2.F) * rest / select(denominator > Float(0.F), denominator, Float(1.F));
  return xsimd::min(from + step, to);
}

// In shares of the interval.
Float Shutter::row_lag(Float raster_y) const {
  const Float row = (raster_y - Float(0.5F)) / Float(rows_ - 1);
  return Float(lag_) * xsimd::min(xsimd::max(row, Float(0.F)), Float(1.F));
}

Float Shutter::time(Float u, Float raster_y) const {
  const Float share = share_of(u);
  if (!rolls()) return share;
  const Float t = Float(start_) + row_lag(raster_y) + Float(width_) * share;
  return xsimd::min(xsimd::max(t, Float(0.F)), Float(1.F));
}

Float Shutter::density(Float share) const {
  const Mask inside = (share >= Float(0.F)) & (share <= Float(1.F));
  const Int i = knot_below(knots_, share), next = i + Int(1);
  const Mask all = all_lanes();
  const Float from = gather(knots_.data(), i, all), to = gather(knots_.data(), next, all);
  const Float e0 = gather(efficiency_.data(), i, all), e1 = gather(efficiency_.data(), next, all);
  return keep(inside, e0 + (e1 - e0) * (share - from) / (to - from));
}

Float Shutter::integral(Float share) const {
  share = xsimd::min(xsimd::max(share, Float(0.F)), Float(1.F));
  const Int i = knot_below(knots_, share);
  const Float from = gather(knots_.data(), i, all_lanes());
  const Float e0 = gather(efficiency_.data(), i, all_lanes());
  return gather(integral_.data(), i, all_lanes()) +
         Float(0.5F) * (e0 + density(share)) * (share - from);
}

Float Shutter::row_weight(Float time, Float raster_y, Float first_y, Float height) const {
  const auto share = [&](Float lag) { return (time - Float(start_) - lag) / Float(width_); };
  const Float here = density(share(row_lag(raster_y)));
  // Rows before the first pixel's middle and after the last one's are exposed as those are.
  const Float before = xsimd::max(Float(0.5F) - first_y, Float(0.F));
  const Float after = xsimd::max(first_y + height - Float(rows_ - 0.5F), Float(0.F));
  const Float between = height - before - after;
  const Float per_lag = Float(width_ / lag_);
  const Float swept = (integral(share(Float(0.F))) - integral(share(Float(lag_)))) * per_lag;
  const Float mean =
      before * density(share(Float(0.F))) + after * density(share(Float(lag_))) + between * swept;
  return here * height / mean;
}

}  // namespace metrofarm::sensor
