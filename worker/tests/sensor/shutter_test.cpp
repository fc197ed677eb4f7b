#include "sensor/shutter.h"

#include <gtest/gtest.h>

#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::sensor {
namespace {

using test::lanes_of;

constexpr int kRows = 40;

ShutterSettings box(double open, double close) {
  return {.open = open, .close = close};
}

struct Curve {
  const char* name;
  ShutterSettings settings;
  double integral;  // of the efficiency, seconds
  double (*efficiency)(double share);
};

std::vector<Curve> curves() {
  ShutterSettings trapezoid = box(1, 3);
  trapezoid.curve = ShutterCurve::kTrapezoid;
  trapezoid.ramp_open = 0.2;
  trapezoid.ramp_close = 0.5;
  ShutterSettings triangle = trapezoid;
  triangle.ramp_open = triangle.ramp_close = 0.5;
  ShutterSettings falling = trapezoid;
  falling.ramp_open = 0;
  falling.ramp_close = 1;
  ShutterSettings table = box(1, 3);
  table.curve = ShutterCurve::kTabulated;
  table.samples = {1, 0, 0, 4, 4};
  return {
      {"Box", box(1, 3), 2, [](double) { return 1.0; }},
      {"Trapezoid", trapezoid, 2 * (0.1 + 0.3 + 0.25),
       [](double s) { return s < 0.2   ? s / 0.2
                             : s < 0.5 ? 1
                                       : (1 - s) / 0.5; }},
      {"Triangle", triangle, 1, [](double s) { return s < 0.5 ? 2 * s : 2 - 2 * s; }},
      {"Falling", falling, 1, [](double s) { return 1 - s; }},
      {"Table", table, 2 * (0.125 + 0 + 0.5 + 1),
       [](double s) {
         if (s < 0.25) return 1 - 4 * s;
         if (s < 0.5) return 0.0;
         return s < 0.75 ? 16 * (s - 0.5) : 4.0;
       }},
  };
}

TEST(Shutter, ExposureIsTheIntegralOfItsCurve) {
  for (Curve c : curves()) {
    EXPECT_EQ(Shutter(c.settings, kRows).exposure(), 1) << c.name;
    c.settings.exposure = Exposure::kCamera;
    EXPECT_NEAR(Shutter(c.settings, kRows).exposure(), c.integral, 1e-6) << c.name;
    c.settings.close += 2;  // twice as long
    EXPECT_NEAR(Shutter(c.settings, kRows).exposure(), 2 * c.integral, 1e-6) << c.name;
  }
}

// Times at equal distances of u: as many before each time as the curve's integral says.
TEST(Shutter, TimesFollowTheCurve) {
  constexpr int kSteps = 100000;
  for (const Curve& c : curves()) {
    const Shutter shutter(c.settings, kRows);
    constexpr int kBins = 50;
    std::vector<double> counts(kBins, 0);
    for (int i = 0; i < kSteps; i += kLanes) {
      Float u;
      test::Lanes values;
      for (int lane = 0; lane < kLanes; ++lane)
        values[lane] = (static_cast<float>(i + lane) + 0.5F) / kSteps;
      u = test::from_lanes(values);
      for (float t : lanes_of(shutter.time(u, Float(0.F)))) {
        ASSERT_GE(t, 0);
        ASSERT_LE(t, 1);
        ++counts[std::min(static_cast<int>(t * kBins), kBins - 1)];
      }
    }
    for (int b = 0; b < kBins; ++b) {
      double expected = 0;
      for (int k = 0; k < 100; ++k) expected += c.efficiency((b + (k + 0.5) / 100) / kBins) / 100;
      expected *= 2 * double(kSteps) / kBins / c.integral;
      EXPECT_NEAR(counts[b], expected, 3 + 0.002 * expected) << c.name << " " << b;
    }
  }
}

TEST(Shutter, RowsOfARollingShutterComeOneAfterTheOther) {
  ShutterSettings s = box(1, 3);
  s.rolling = 6;
  const Shutter shutter(s, kRows);
  EXPECT_EQ(shutter.interval(), (motion::Interval{1, 9}));
  const auto at = [&](float u, float y) { return lanes_of(shutter.time(Float(u), Float(y)))[0]; };
  EXPECT_NEAR(at(0.5F, 0.5F), 1.0 / 8, 1e-6);   // the first row, opens at 1
  EXPECT_NEAR(at(0.5F, 39.5F), 7.0 / 8, 1e-6);  // the last row
  EXPECT_NEAR(at(0, 20), 3.0 / 8, 1e-6);
  EXPECT_NEAR(at(0, -3), 0, 1e-6);  // the border goes with the first row
  s.rolling = -6;
  const Shutter back(s, kRows);
  EXPECT_EQ(back.interval(), (motion::Interval{-5, 3}));
  EXPECT_NEAR(lanes_of(back.time(Float(0.F), Float(39.5F)))[0], 0, 1e-6);
  EXPECT_NEAR(lanes_of(back.time(Float(0.F), Float(0.5F)))[0], 6.0 / 8, 1e-6);
}

// Density of a row's times over the mean of all rows': its mean over uniform rows is 1 at any time,
// and its mean over the times of uniform rows is 1 for any row.
TEST(Shutter, RowWeightsAreDensities) {
  for (const Curve& c : curves()) {
    ShutterSettings s = c.settings;
    s.rolling = 1.5;
    const Shutter shutter(s, kRows);
    const Float first(-2.F), height(44.F);
    for (float time : {0.07F, 0.3F, 0.61F, 0.9F}) {
      double mean = 0;
      constexpr int kSteps = 40000;
      for (int i = 0; i < kSteps; ++i) {
        const float y = -2 + 44 * (static_cast<float>(i) + 0.5F) / kSteps;
        mean += lanes_of(shutter.row_weight(Float(time), Float(y), first, height))[0] / kSteps;
      }
      EXPECT_NEAR(mean, 1, 2e-3) << c.name << " at " << time;
    }
    test::UniformLanes random(2);
    test::Moments weight;
    for (int i = 0; i < 40000; ++i) {
      const Float y = first + random.next() * height;
      const Float time = shutter.time(random.next(), y);
      for (float w : lanes_of(shutter.row_weight(time, Float(17.3F), first, height))) weight.add(w);
    }
    EXPECT_TRUE(test::has_mean(weight, 1, 1e-6, 1e-3)) << c.name;
  }
}

TEST(Shutter, BadSettingsAreNamed) {
  EXPECT_EQ(problem_with(box(0, 1)), "");
  EXPECT_EQ(problem_with(box(0, 0)), "");
  EXPECT_EQ(problem_with(box(1, 0)), "shutter_close must not be before shutter_open");
  EXPECT_EQ(problem_with(box(0, NAN)), "shutter_open and shutter_close must be finite");
  ShutterSettings s = box(0, 0);
  s.exposure = Exposure::kCamera;
  EXPECT_EQ(problem_with(s), "exposure camera needs a shutter_close later than shutter_open");
  s = box(0, 0);
  s.rolling = 1;
  EXPECT_EQ(problem_with(s), "rolling_shutter needs a shutter_close later than shutter_open");
  s = box(0, 1);
  s.ramp_open = 0.5;
  EXPECT_NE(problem_with(s), "");
  s.curve = ShutterCurve::kTrapezoid;
  EXPECT_EQ(problem_with(s), "");
  s.ramp_close = 0.6;
  EXPECT_NE(problem_with(s), "");
  s = box(0, 1);
  s.samples = {1, 1};
  EXPECT_NE(problem_with(s), "");
  s.curve = ShutterCurve::kTabulated;
  EXPECT_EQ(problem_with(s), "");
  for (const std::vector<double>& bad :
       {std::vector<double>{1}, {1, -1}, {0, 0}, {1, NAN}, std::vector<double>(1025, 1)}) {
    s.samples = bad;
    EXPECT_NE(problem_with(s), "");
  }
}

}  // namespace
}  // namespace metrofarm::sensor
