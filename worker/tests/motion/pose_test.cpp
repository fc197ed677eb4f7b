#include "motion/pose.h"

#include <gtest/gtest.h>

#include "tests/motion/motions.h"

namespace metrofarm::motion {
namespace {

using namespace test;

TEST(Pose, PartsMakeTheMapAgain) {
  const Matrix shear = {2, 1, 0, 0, 1, 3, 0.5, 0, 0, 0.5, 1, 0, 0, 0, 0, 1};
  const Matrix maps[] = {
      kIdentity,
      translated(1, 2, 3),
      turned({1, 2, 3}, 170),
      multiply(translated(5, 6, 7), multiply(turned({0, 1, 1}, 300), shear)),
      multiply(turned({0, 0, 1}, 180), scaled(-1, 2, 3)),
      multiply(shear, turned({1, 0, 0}, 90)),
      scaled(1e-12, 1e-12, 1e-12),
      {0, 0, 1e6, 1, 1e6, 0, 0, 2, 0, 1e6, 0, 3, 0, 0, 0, 1},
  };
  for (const Matrix& m : maps) {
    const auto parts = decompose(m);
    ASSERT_TRUE(parts);
    const Matrix again = compose(*parts);
    for (int i = 0; i < 16; ++i) EXPECT_NEAR(again[i], m[i], 1e-13 * (1 + std::fabs(m[i])));
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < i; ++j)
        EXPECT_NEAR(parts->stretch[3 * i + j], parts->stretch[3 * j + i], 1e-9);
    }
  }
}

TEST(Pose, RotationsAreFoundAtEveryAngle) {
  for (double degrees : {0.0, 1e-6, 90.0, 179.999, 180.0, 180.001, 270.0, 359.0}) {
    for (const Point& axis : {Point{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}, {-3, 2, 0.1}}) {
      const Linear m = scene::linear_part(turned(axis, degrees));
      const Linear again = to_linear(to_quaternion(m));
      for (int i = 0; i < 9; ++i) EXPECT_NEAR(again[i], m[i], 1e-14) << degrees;
    }
  }
}

TEST(Pose, WhatFlattensHasNone) {
  EXPECT_FALSE(decompose(scaled(1, 1, 0)));
  EXPECT_FALSE(decompose(scaled(0, 0, 0)));
  EXPECT_FALSE(decompose({1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}));
}

}  // namespace
}  // namespace metrofarm::motion
