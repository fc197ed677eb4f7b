#include "motion/pose_table.h"

#include <gtest/gtest.h>

#include "tests/motion/motions.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::motion {
namespace {

using namespace test;
using metrofarm::test::lane_of;
using metrofarm::test::UniformLanes;

Matrix lane_matrix(const LanePose& pose, int lane) {
  Matrix m = kIdentity;
  for (int c = 0; c < 4; ++c) {
    const auto v = lane_of(c < 3 ? pose.column[c] : pose.offset, lane);
    m[c] = v.x;
    m[4 + c] = v.y;
    m[8 + c] = v.z;
  }
  return m;
}

struct Case {
  const char* name;
  scene::Motion motion;
  Interval interval;
  double tolerance;
};

std::vector<Case> cases() {
  constexpr Point kY = {0, 1, 0};
  std::vector<Case> all;
  all.push_back({"Straight", {{{0, kIdentity}, {1, translated(3, -2, 1)}}}, {0.25, 0.75}, 1e-6});
  all.push_back({"Turn", {{turn_key(0, kY, 0), turn_key(1, kY, 30)}}, {0, 1}, 1e-4});
  all.push_back({"ThreeTurns", {{turn_key(0, kY, 0), turn_key(1, kY, 1080)}}, {0, 1}, 3e-6});
  // Poses that come back again and again, at the times one would look at first.
  all.push_back({"FourTurns", {{turn_key(0, kY, 0), turn_key(1, kY, 1440)}}, {0, 1}, 3e-6});
  scene::Motion there_and_back;
  for (int i = 0; i <= 8; ++i) there_and_back.keys.push_back({i / 8.0, translated(i % 2, 0, 0)});
  all.push_back({"ThereAndBack", there_and_back, {0, 1}, 1e-6});
  all.push_back({"ScaledAndMirrored",
                 {{{0, multiply(turned({1, 2, 3}, 20), scaled(-1, 2, 1))},
                   {1, multiply(turned({1, 2, 3}, 110), scaled(-2, 1, 1))}}},
                 {0, 1},
                 3e-4});
  scene::Motion wavy{{}, scene::MotionPath::kCatmullRom};
  for (int i = 0; i <= 8; ++i)
    wavy.keys.push_back(turn_key(i * 0.125, kY, 20 * (i % 3), {std::sin(i * 1.0), 0, 0.1 * i}));
  all.push_back({"ManyKeys", wavy, {0, 1}, 1e-3});
  all.push_back({"KeyInsideTheShutter",
                 {{turn_key(0, kY, 0), turn_key(0.3, kY, 50, {1, 0, 0}), turn_key(1, kY, 0)}},
                 {0, 1},
                 1e-4});
  return all;
}

TEST(PoseTable, FollowsTheTrack) {
  for (const Case& c : cases()) {
    const Track track(c.motion);
    PoseTable table(c.interval);
    table.add(Track({{{0, kIdentity}, {1, translated(9, 9, 9)}}}), kIdentity, 1, 1);
    const Matrix inner = scaled(1, 1, 0.5);
    const int32_t number = table.add(track, inner, 1, 1);
    UniformLanes random(1);
    for (int i = 0; i < 100; ++i) {
      const Float time = i == 0 ? Float(0.F) : i == 1 ? Float(1.F) : random.next();
      const LanePose pose = table.at(Int(number), time, all_lanes());
      for (int lane = 0; lane < kLanes; ++lane) {
        const double at = c.interval.begin + c.interval.length() * double(lane_value(time, lane));
        EXPECT_LT(largest_difference(lane_matrix(pose, lane), multiply(track.at(at), inner)),
                  c.tolerance)
            << c.name << " at " << at;
      }
    }
  }
}

// Rays are carried by pose(), surfaces by at().
TEST(PoseTable, OneAtATimeIsTheSame) {
  for (const Case& c : cases()) {
    PoseTable table(c.interval);
    table.add(Track({{turn_key(0, {1, 0, 0}, 0), turn_key(1, {0, 1, 0}, 300)}}), kIdentity, 1, 1);
    const int32_t number = table.add(Track(c.motion), kIdentity, 1, 1);
    UniformLanes random(2);
    for (int i = 0; i < 50; ++i) {
      const Float time = i == 0 ? Float(0.F) : i == 1 ? Float(1.F) : random.next();
      const LanePose lanes = table.at(Int(number), time, all_lanes());
      for (int lane = 0; lane < kLanes; ++lane) {
        const Pose one = table.pose(static_cast<size_t>(number), lane_value(time, lane));
        const Matrix m = lane_matrix(lanes, lane);
        for (int r = 0; r < 3; ++r) {
          for (int k = 0; k < 3; ++k) EXPECT_EQ(one.linear[3 * k + r], m[4 * r + k]);
          EXPECT_EQ(one.offset[r], m[4 * r + 3]);
        }
      }
    }
  }
}

// Points within reach stay within the bulge of the line between both ends of a part.
TEST(PoseTable, BulgesHoldWhatTurns) {
  for (const Case& c : cases()) {
    PoseTable table(c.interval);
    table.add(Track(c.motion), kIdentity, 1, 1);
    const int parts = table.parts(0), count = parts * (table.step_count(0) - 1);
    const Point points[] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-0.6, 0, 0.8}};
    const auto place = [&](double share, const Point& p) {
      const Pose m = table.pose(0, static_cast<float>(share));
      Point out;
      for (size_t r = 0; r < 3; ++r)
        out[r] = m.linear[r] * p[0] + m.linear[3 + r] * p[1] + m.linear[6 + r] * p[2] + m.offset[r];
      return out;
    };
    double least_room = 1e30;
    for (int i = 0; i < count; ++i) {
      const double bulge = table.bulge(0, i / parts, parts, 1);
      for (const Point& p : points) {
        const Point a = place(double(i) / count, p), b = place(double(i + 1) / count, p);
        const Point half = place((i + 0.5) / count, p);
        double apart = 0;
        for (size_t k = 0; k < 3; ++k) apart = std::hypot(apart, half[k] - (a[k] + b[k]) / 2);
        EXPECT_LE(apart, bulge + 1e-6) << c.name;
        least_room = std::min(least_room, bulge - apart);
      }
    }
    EXPECT_LT(least_room, 0.01) << c.name << ": not much more than it takes";
  }
}

TEST(PoseTable, FewStepsWhereFewWillDo) {
  PoseTable table({0, 1});
  table.add(Track({{{0, kIdentity}, {1, translated(1, 0, 0)}}}), kIdentity, 1, 1);
  EXPECT_EQ(table.step_count(0), 2);
  scene::Motion even;
  for (int i = 0; i <= 31; ++i) even.keys.push_back({i / 31.0, translated(std::sin(i), 0, 0)});
  table.add(Track(even), kIdentity, 1, 1);
  EXPECT_LE(table.step_count(1), 129);
  // At constant speed arcs are exact: a step for each eighth of a turn.
  table.add(Track({{turn_key(0, {0, 1, 0}, 0), turn_key(1, {0, 1, 0}, 1080)}}), kIdentity, 1, 1);
  EXPECT_LE(table.step_count(2), 25);
}

// What a camera or a light sees changes with where it is, however large the scene around it.
TEST(PoseTable, ViewpointsFollowTheirWayInLargeScenes) {
  constexpr double kWay = 0.01, kRadius = 1e4;
  scene::Motion wavy{{}, scene::MotionPath::kCatmullRom};
  for (int i = 0; i <= 8; ++i)
    wavy.keys.push_back({i * 0.125, translated(kWay * std::sin(0.8 * i), kWay * 0.125 * i, 0)});
  const Track track(wavy);
  PoseTable table({0, 1});
  table.add_viewpoint(track, kIdentity, kRadius);
  table.add(track, kIdentity, kRadius, kRadius);
  double largest = 0, of_a_thing = 0;
  for (int i = 0; i <= 500; ++i) {
    const double at = i / 500.0;
    const auto error = [&](int number) {
      const LanePose pose = table.at(Int(number), Float(static_cast<float>(at)), all_lanes());
      return largest_difference(lane_matrix(pose, 0), track.at(at));
    };
    largest = std::max(largest, error(0));
    of_a_thing = std::max(of_a_thing, error(1));
  }
  EXPECT_LT(largest, 2e-3 * kWay);
  EXPECT_GT(of_a_thing, 0.1 * kWay) << "of something so large the way is no matter";
}

// A turn of a single point changes nothing but where the point is.
TEST(PoseTable, PointsMove) {
  const Track track({{turn_key(0, {0, 1, 0}, 0), turn_key(1, {0, 1, 0}, 90, {1, 0, 0})}});
  PoseTable table({0, 1});
  for (const double reach : {0.0, 1e-30, 1.0}) {
    const int32_t number = table.add(track, kIdentity, reach, 0);
    for (const float time : {0.F, 0.4F, 1.F}) {
      const LanePose pose = table.at(Int(number), Float(time), all_lanes());
      for (int i = 0; i < 12; ++i) {
        EXPECT_TRUE(std::isfinite(lane_matrix(pose, 0)[i])) << reach;
        if (time == 0.4F) continue;
        EXPECT_NEAR(lane_matrix(pose, 0)[i], track.at(double(time))[i], 1e-6);
      }
    }
  }
}

TEST(PoseTable, InverseUndoesAPose) {
  PoseTable table({0, 1});
  const Matrix from = multiply(turned({1, 2, 3}, 20), scaled(-1, 2, 1));
  table.add(Track({{{0, from}, {1, multiply(turned({3, 2, 1}, 99), scaled(-2, 1, 1))}}}), kIdentity,
            1, 1);
  UniformLanes random(5);
  for (int i = 0; i < 50; ++i) {
    const LanePose pose = table.at(Int(0), random.next(), all_lanes());
    const LaneInverse inverse = inverse_of(pose);
    const Vec3 v = random.direction(), n = random.direction();
    const Vec3 again = inverse.vector(pose.vector(v));
    const Float before = dot(n, v), after = dot(inverse.normal(n), pose.vector(v));
    for (int lane = 0; lane < kLanes; ++lane) {
      EXPECT_NEAR(length(lane_of(again - v, lane)), 0, 2e-6);
      EXPECT_NEAR(lane_value(after, lane), lane_value(before, lane), 2e-6);
    }
  }
}

}  // namespace
}  // namespace metrofarm::motion
