// H0 of every chi-square test here: the warp draws from the pdf that it states. 200,000 samples on
// a 20 x 20 grid, fixed seeds, false-alarm rate 1e-5 per test.
#include "math/warp.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm {
namespace {

using test::Double3;
using test::Histogram;

constexpr int kSamples = 200000;
constexpr double kFalseAlarm = 1e-5;

// Counts where `locate` puts each sample on the unit square, and compares with equal cells: locate
// is a map under which the stated pdf becomes uniform, worked out by hand for each domain.
void expect_uniform_under(uint64_t seed, const std::function<Vec3(Vec2)>& warp,
                          const std::function<std::pair<double, double>(Double3)>& locate) {
  test::UniformLanes random(seed);
  Histogram observed(20, 20), expected(20, 20);
  for (int i = 0; i < kSamples; i += kLanes) {
    const Vec3 v = warp(random.pair());
    for (int lane = 0; lane < kLanes; ++lane) {
      const auto [a, b] = locate(test::lane_of(v, lane));
      observed.add(a, b);
    }
  }
  for (int x = 0; x < 20; ++x)
    for (int y = 0; y < 20; ++y) expected.add_to(x, y, kSamples / 400.0);
  EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), kFalseAlarm));
}

TEST(Warp, SincosAgreesWithTheLibrary) {
  double worst = 0;
  for (uint32_t i = 0; i < 1U << 24; i += 61) {
    const float u = static_cast<float>(i) * 0x1p-24F;
    const SinCos a = sincos_turn(Float(u));
    const double angle = 2 * std::numbers::pi * double(u);
    worst = std::max(worst, std::fabs(lane_value(a.sin, 0) - std::sin(angle)));
    worst = std::max(worst, std::fabs(lane_value(a.cos, 0) - std::cos(angle)));
  }
  EXPECT_LT(worst, 2.5e-7);
}

TEST(Warp, SincosIsExactAtQuarters) {
  const auto at = [](float u) { return sincos_turn(Float(u)); };
  EXPECT_EQ(lane_value(at(0.F).sin, 0), 0.F);
  EXPECT_EQ(lane_value(at(0.25F).sin, 0), 1.F);
  EXPECT_EQ(lane_value(at(0.5F).cos, 0), -1.F);
  EXPECT_EQ(lane_value(at(0.75F).sin, 0), -1.F);
  EXPECT_NEAR(lane_value(at(kOneMinusEpsilon).sin, 0), 0.F, 1e-6);
}

// pdf_area = 1 / pi: r^2 and the azimuth are uniform.
TEST(Warp, DiskFollowsItsPdf) {
  expect_uniform_under(
      1,
      [](Vec2 u) {
        const Vec2 d = square_to_disk(u);
        return Vec3{d.x, d.y, Float(0.F)};
      },
      [](Double3 v) { return std::pair(v.x * v.x + v.y * v.y, test::turns(v.x, v.y)); });
}

// pdf_solid_angle = z / pi: z^2 and the azimuth are uniform.
TEST(Warp, CosineHemisphereFollowsItsPdf) {
  expect_uniform_under(2, square_to_cosine_hemisphere,
                       [](Double3 v) { return std::pair(v.z * v.z, test::turns(v.x, v.y)); });
}

// pdf_solid_angle = 1 / (4 pi): z and the azimuth are uniform.
TEST(Warp, SphereFollowsItsPdf) {
  expect_uniform_under(3, square_to_sphere,
                       [](Double3 v) { return std::pair(0.5 + 0.5 * v.z, test::turns(v.x, v.y)); });
}

class ConeTest : public testing::TestWithParam<float> {};

// pdf_solid_angle = 1 / (2 pi (1 - cos)): 1 - z and the azimuth are uniform; 1 - z comes from x and
// y, because z itself has no digits left in a narrow cone.
TEST_P(ConeTest, FollowsItsPdf) {
  const float one_minus_cos = GetParam();
  expect_uniform_under(
      4, [=](Vec2 u) { return square_to_cone(u, Float(one_minus_cos)); },
      [=](Double3 v) {
        const double r2 = v.x * v.x + v.y * v.y;
        const double drop = v.z > 0 ? r2 / (1 + std::sqrt(1 - r2)) : 1 + std::sqrt(1 - r2);
        return std::pair(drop / one_minus_cos, test::turns(v.x, v.y));
      });
}

INSTANTIATE_TEST_SUITE_P(Widths, ConeTest, testing::Values(1.F, 0.3F, 1e-3F, 1e-7F, 1e-12F));

// pdf_area = 1 / area: under (1 - b0)^2 and b2 / (1 - b0) the triangle becomes the square.
TEST(Warp, TriangleFollowsItsPdf) {
  expect_uniform_under(
      5,
      [](Vec2 u) {
        const Vec2 b = square_to_triangle(u);
        return Vec3{b.x, b.y, Float(0.F)};
      },
      [](Double3 b) {
        const double s = b.x + b.y;
        return std::pair(s * s, s > 0 ? b.y / s : 0.0);
      });
}

TEST(Warp, DirectionsAreUnitVectors) {
  test::UniformLanes random(6);
  for (int i = 0; i < 2000; ++i) {
    const Vec2 u = random.pair();
    for (const Vec3& v : {square_to_sphere(u), square_to_cosine_hemisphere(u),
                          square_to_cone(u, Float(0.2F)), square_to_cone(u, Float(1e-9F))}) {
      for (float l : test::lanes_of(length(v))) EXPECT_NEAR(l, 1, 1e-6);
    }
  }
}

TEST(Warp, TrianglePointsLieInside) {
  test::UniformLanes random(7);
  for (int i = 0; i < 2000; ++i) {
    const Vec2 b = square_to_triangle(random.pair());
    EXPECT_TRUE(all((b.x >= Float(0.F)) & (b.y >= Float(0.F)) & (b.x + b.y <= Float(1.F + 1e-6F))));
  }
}

}  // namespace
}  // namespace metrofarm
