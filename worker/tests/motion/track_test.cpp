#include "motion/track.h"

#include <gtest/gtest.h>

#include "tests/motion/motions.h"

namespace metrofarm::motion {
namespace {

using namespace test;
using scene::Keyframe;
using scene::MotionPath;

constexpr Point kY = {0, 1, 0};

TEST(Track, IsExactAtKeysAndHoldsOutside) {
  const Matrix odd = {0.1, 0.7, -0.3, 1.1, 0.9, 0.2, 0.4, 2.2, -0.5, 0.3, 0.8, 3.3, 0, 0, 0, 1};
  const Track track({{{-2, odd}, turn_key(0.5, kY, 77, {1, 2, 3}), {4, scaled(3, 2, 1)}}});
  EXPECT_EQ(track.at(-9), odd);
  EXPECT_EQ(track.at(-2), odd);
  EXPECT_EQ(track.at(0.5), turn_key(0.5, kY, 77, {1, 2, 3}).to_world);
  EXPECT_EQ(track.at(4), scaled(3, 2, 1));
  EXPECT_EQ(track.at(1e9), scaled(3, 2, 1));
  // And they are met without a jump.
  EXPECT_LT(largest_difference(track.at(0.5 - 1e-9), track.at(0.5)), 1e-8);
  EXPECT_LT(largest_difference(track.at(0.5 + 1e-9), track.at(0.5)), 1e-8);
}

// A ball that spins: the right angle at every time, however often it goes round, no shrinking and
// no seam.
TEST(Track, TurnsTheWholeWay) {
  for (double degrees : {90.0, 180.0, 270.0, 360.0, 540.0, 720.0, 1890.0, -900.0}) {
    const Track track({{turn_key(0, kY, 0), turn_key(1, kY, degrees)}});
    EXPECT_TRUE(track.moves_during({0.2, 0.3}));
    for (int i = 0; i <= 64; ++i) {
      const Matrix pose = track.at(i / 64.0);
      EXPECT_LT(largest_difference(pose, turned(kY, degrees * i / 64)), 1e-12) << degrees;
      EXPECT_NEAR(scene::determinant(scene::linear_part(pose)), 1, 1e-13);
    }
  }
}

TEST(Track, QuartersOfATurnAreExact) {
  const Track track({{turn_key(0, kY, 0), turn_key(4, kY, 720)}});
  for (int quarter = 0; quarter <= 8; ++quarter) {
    const double s[] = {0, 1, 0, -1}, c[] = {1, 0, -1, 0};
    const Matrix expected = {c[quarter % 4],  0, s[quarter % 4], 0, 0, 1, 0, 0,
                             -s[quarter % 4], 0, c[quarter % 4], 0, 0, 0, 0, 1};
    EXPECT_LT(largest_difference(track.at(quarter / 2.0), expected), 4e-15) << quarter;
  }
}

// Matrices alone do not know of turns: the shorter arc.
TEST(Track, TakesTheShorterArcUnlessTurnsAreTold) {
  const Track plain({{{0, turned(kY, 10)}, {1, turned(kY, 350)}}});
  EXPECT_LT(largest_difference(plain.at(0.5), kIdentity), 1e-15);
  const Track told({{turn_key(0, kY, 10), turn_key(1, kY, 350)}});
  EXPECT_LT(largest_difference(told.at(0.5), turned(kY, 180)), 1e-14);
  // Another axis, or a pose that the turns don't explain: no telling.
  Keyframe other = turn_key(1, {0, 0, 1}, 350);
  EXPECT_FALSE(Track({{turn_key(0, kY, 10), other}}).moving().empty());
  Keyframe wrong = turn_key(1, kY, 350);
  wrong.to_world = turned(kY, 30);
  EXPECT_LT(largest_difference(Track({{turn_key(0, kY, 10), wrong}}).at(0.5), turned(kY, 20)),
            1e-14);
}

// The axis of the turn that differs is carried by those after it.
TEST(Track, TurnsAmongOtherTurns) {
  const auto key = [](double time, double degrees) {
    Keyframe k{time, multiply(turned({1, 0, 0}, 90),
                              multiply(turned({0, 0, 1}, degrees), turned({0, 1, 0}, 40)))};
    k.turns = {{{0, 1, 0}, 40}, {{0, 0, 1}, degrees}, {{1, 0, 0}, 90}};
    return k;
  };
  const Track track({{key(0, 30), key(1, 750)}});
  for (double t : {0.1, 0.35, 0.8})
    EXPECT_LT(largest_difference(track.at(t), key(0, 30 + 720 * t).to_world), 1e-13);
}

TEST(Track, StretchAndPathAreLinear) {
  const Matrix stretch = {2, 1, 0, 0, 1, 3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (const Matrix& s : {stretch, scaled(-1, -2, -3)}) {
    const Track track(
        {{{0, multiply(turned({1, 2, 3}, 170), s)},
          {1, multiply(translated(4, 0, -8),
                       multiply(turned({1, 2, 3}, 270), multiply(s, scaled(3, 3, 3))))}}});
    const Matrix expected = multiply(
        translated(1, 0, -2), multiply(turned({1, 2, 3}, 195), multiply(s, scaled(1.5, 1.5, 1.5))));
    EXPECT_LT(largest_difference(track.at(0.25), expected), 1e-12);
  }
}

TEST(Track, BezierFollowsItsControlPoints) {
  scene::Motion motion{{{0, kIdentity}, {2, translated(3, 0, 0)}}, MotionPath::kBezier};
  motion.keys[0].out = {0, 3, 0};
  motion.keys[1].in = {3, 3, 0};
  const Matrix middle = Track(motion).at(1);
  EXPECT_NEAR(middle[3], 1.5, 1e-15);
  EXPECT_NEAR(middle[7], 2.25, 1e-15);
  const Matrix early = Track(motion).at(0.5);  // s = 1/4
  EXPECT_NEAR(early[3], 3 * 0.75 * 0.0625 * 3 + 0.015625 * 3, 1e-15);
  EXPECT_NEAR(early[7], 3 * 0.5625 * 0.25 * 3 + 3 * 0.75 * 0.0625 * 3, 1e-15);
}

// Catmull-Rom for unequal times repeats parabolas, whose slope three keys know.
TEST(Track, CatmullRomRepeatsAParabola) {
  scene::Motion motion{{}, MotionPath::kCatmullRom};
  const auto at = [](double t) { return translated(t * t - t, 2 * t, 1 - 3 * t * t); };
  for (double t : {0.0, 1.0, 1.5, 4.0, 5.0}) motion.keys.push_back({t, at(t)});
  const Track track(motion);
  for (double t : {1.1, 1.49, 2.0, 3.7}) EXPECT_LT(largest_difference(track.at(t), at(t)), 1e-13);
}

TEST(Track, KnowsWhenItMoves) {
  const Track track({{{0, kIdentity},
                      {1, kIdentity},
                      {2, translated(1, 0, 0)},
                      {3, translated(2, 0, 0)},
                      {5, translated(2, 0, 0)}}});
  EXPECT_EQ(track.moving(), (std::vector<Interval>{{1, 3}}));
  EXPECT_FALSE(track.moves_during({0, 1}));
  EXPECT_FALSE(track.moves_during({3, 9}));
  EXPECT_FALSE(track.moves_during({2, 2}));
  EXPECT_TRUE(track.moves_during({2.9, 9}));
  // A whole turn comes back to where it began, and moves.
  EXPECT_EQ(Track({{turn_key(0, kY, 0), turn_key(1, kY, 360)}}).moving().size(), 1U);
}

TEST(Track, RefusesKeysThatFlatten) {
  EXPECT_FALSE(Track::problem_with({{{0, kIdentity}, {1, turned(kY, 3)}}}));
  EXPECT_TRUE(Track::problem_with({{{0, kIdentity}, {1, scaled(1, 0, 1)}}}));
}

}  // namespace
}  // namespace metrofarm::motion
