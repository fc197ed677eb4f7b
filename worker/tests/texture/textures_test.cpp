// Lookups against values from Mitsuba, against formulas written out in double, and derivatives
// against differences.
#include "texture/textures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "mitsuba_values.h"
#include "spectrum/srgb.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::texture::test {
namespace {

using metrofarm::test::lane_of;
using metrofarm::test::lanes_of;
using metrofarm::test::UniformLanes;

// A scene that consists of textures, and its lookups.
struct Bench {
  std::vector<scene::Texture> descriptions;
  Images images;
  geometry::Primitives primitives;
  Textures textures{descriptions, images, primitives};

  Bench(std::vector<scene::Texture> texture_list, std::vector<scene::Image> image_list,
        geometry::Primitives tables = {})
      : descriptions(std::move(texture_list)),
        images(std::move(image_list)),
        primitives(std::move(tables)) {}

  static geometry::SurfacePoint at(Float u, Float v) {
    return {{u, v}, Int(0), Float(0.F), Float(0.F)};
  }
  Spectrum colour(int texture, Float u, Float v) const {
    return textures.colour(Int(texture), at(u, v), all_lanes());
  }
  scene::Rgb colour(int texture, float u, float v) const {
    const auto c = lane_of(colour(texture, Float(u), Float(v)), 3);
    return {static_cast<float>(c.x), static_cast<float>(c.y), static_cast<float>(c.z)};
  }
  Gradient gradient(int texture, Float u, Float v) const {
    return textures.gradient(Int(texture), at(u, v), all_lanes());
  }
};

scene::Image table_image() {
  return {kWidth, kHeight, 3, std::vector<float>(kPixels.begin(), kPixels.end())};
}

scene::Texture bitmap(Filter filter, Wrap wrap, const scene::UvMatrix& to_uv = scene::kIdentityUv) {
  return {scene::BitmapTexture{0, filter, wrap, to_uv}, "", {}};
}

// To coordinates with v = 0 at the lower edge.
scene::UvMatrix upside_down(const scene::UvMatrix& m) {
  return {m[0], m[1], m[2], -m[3], -m[4], 1 - m[5]};
}

TEST(Textures, BitmapsAgreeWithMitsuba) {
  for (const BitmapValue& row : kBitmapValues) {
    const Bench bench({bitmap(row.filter, row.wrap, upside_down(row.to_uv))}, {table_image()});
    const scene::Rgb colour = bench.colour(0, row.uv[0], row.uv[1]);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(colour[c], row.colour[c], 2e-5) << row.uv[0];
    if (std::isnan(row.gradient[0])) continue;
    const Gradient g = bench.gradient(0, Float(row.uv[0]), Float(row.uv[1]));
    EXPECT_NEAR(lane_value(g.du, 0), row.gradient[0], 1e-4) << row.uv[0] << ' ' << row.uv[1];
    EXPECT_NEAR(lane_value(g.dv, 0), row.gradient[1], 1e-4) << row.uv[0] << ' ' << row.uv[1];
  }
}

TEST(Textures, CheckerboardsAgreeWithMitsuba) {
  scene::CheckerboardTexture board;
  board.to_uv = kCheckerboardToUv;
  const Bench bench({{board, "", {}}}, {});
  for (const CheckerboardValue& row : kCheckerboardValues)
    EXPECT_EQ(bench.colour(0, row.uv[0], row.uv[1])[1], row.value) << row.uv[0];
}

// The interpolant written out: texel centers at (i + 0.5) / size, v upwards.
double reference(double u, double v, Wrap wrap, int channel) {
  const auto wrapped = [&](int i, int n) {
    if (wrap == Wrap::kClamp) return std::clamp(i, 0, n - 1);
    const int period = wrap == Wrap::kMirror ? 2 * n : n;
    const int r = (i % period + period) % period;
    return r < n ? r : period - 1 - r;
  };
  const double x = u * kWidth - 0.5, y = (1 - v) * kHeight - 0.5;
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  double sum = 0;
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 2; ++i) {
      const double wx = i == 1 ? x - x0 : 1 - (x - x0);
      const double wy = j == 1 ? y - y0 : 1 - (y - y0);
      const int pixel = wrapped(y0 + j, kHeight) * kWidth + wrapped(x0 + i, kWidth);
      sum += wx * wy * static_cast<double>(kPixels[3 * pixel + channel]);
    }
  return sum;
}

class WrapModes : public ::testing::TestWithParam<Wrap> {};

TEST_P(WrapModes, InterpolateBetweenPixelCenters) {
  const Bench bench({bitmap(Filter::kBilinear, GetParam())}, {table_image()});
  UniformLanes random(1);
  for (int round = 0; round < 200; ++round) {
    const Float u = random.next() * Float(8.F) - Float(4.F);
    const Float v = random.next() * Float(8.F) - Float(4.F);
    const Spectrum colour = bench.colour(0, u, v);
    for (int lane = 0; lane < kLanes; ++lane) {
      const double at_u = lane_value(u, lane), at_v = lane_value(v, lane);
      // A coordinate of 4 is known to 2e-7, a slope is at most 15 per unit.
      EXPECT_NEAR(lane_of(colour, lane).x, reference(at_u, at_v, GetParam(), 0), 2e-5);
      EXPECT_NEAR(lane_of(colour, lane).z, reference(at_u, at_v, GetParam(), 2), 2e-5);
    }
  }
}

TEST_P(WrapModes, GradientIsTheSlope) {
  const scene::UvMatrix turned = {0.8F, -0.6F, 0.1F, 0.6F, 0.8F, -0.2F};
  const Bench bench({bitmap(Filter::kBilinear, GetParam(), turned)}, {table_image()});
  UniformLanes random(2);
  constexpr float kStep = 0x1p-9F;
  int compared = 0;
  for (int round = 0; round < 200; ++round) {
    const Float u = random.next() * Float(4.F) - Float(2.F);
    const Float v = random.next() * Float(4.F) - Float(2.F);
    const auto value = [&](float du, float dv) {
      return lanes_of(luminance(bench.colour(0, u + Float(du), v + Float(dv))));
    };
    const auto here = value(0, 0);
    const auto right = value(kStep, 0), left = value(-kStep, 0);
    const auto up = value(0, kStep), down = value(0, -kStep);
    const Gradient g = bench.gradient(0, u, v);
    for (int lane = 0; lane < kLanes; ++lane) {
      // Differences to both sides disagree by much where a pixel's edge lies between.
      const auto bend = [&](float a, float b) { return std::abs(a + b - 2 * here[lane]); };
      if (std::max(bend(right[lane], left[lane]), bend(up[lane], down[lane])) > 1e-4F) continue;
      ++compared;
      EXPECT_NEAR(lane_value(g.du, lane), (right[lane] - left[lane]) / (2 * kStep), 0.04);
      EXPECT_NEAR(lane_value(g.dv, lane), (up[lane] - down[lane]) / (2 * kStep), 0.04);
    }
  }
  EXPECT_GT(compared, 1000);
}

// Whatever the coordinate, a lookup stays inside the image (run under the address sanitizer).
TEST_P(WrapModes, BearAnyCoordinate) {
  const float infinity = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const Filter filter : {Filter::kBilinear, Filter::kNearest}) {
    const Bench bench({bitmap(filter, GetParam())}, {table_image()});
    for (const float c :
         {-0x1p-30F, -0.F, 0x1p-30F, 1 - 0x1p-24F, 1.F, 2.F, -1.F, 1e9F, -1e9F, 3e38F, -3e38F})
      for (const float d : {0.3F, c})
        for (const float value : bench.colour(0, c, d)) EXPECT_TRUE(value >= 0 && value <= 2.5F);
    for (const float c : {infinity, -infinity, nan}) (void)bench.colour(0, c, 0.5F);
  }
}

INSTANTIATE_TEST_SUITE_P(All, WrapModes,
                         ::testing::Values(Wrap::kRepeat, Wrap::kMirror, Wrap::kClamp));

TEST(Textures, LanesMayHaveDifferentTextures) {
  scene::Image grey{2, 1, 1, std::vector<uint8_t>{0, 255}};
  scene::Texture other = bitmap(Filter::kNearest, Wrap::kRepeat);
  std::get<scene::BitmapTexture>(other.model).image = 1;
  scene::CheckerboardTexture board;
  board.colour0 = scene::Colour({2, 3, 4}, 0);
  board.colour1 = scene::Colour(5, 6, 7);
  const Bench bench({bitmap(Filter::kBilinear, Wrap::kRepeat), other, {board, "", {}}},
                    {table_image(), grey});
  const Int texture = Int(_mm256_setr_epi32(0, 1, 2, 0, 1, 2, 0, 1));
  const Float u = Float(0.125F) * to_float(Int(_mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 8)));
  const Float v(0.4F);
  const Mask lanes = mask_from_bits(0x7f);
  const Spectrum mixed = bench.textures.colour(texture, Bench::at(u, v), lanes);
  const std::array<int, kLanes> of = {0, 1, 2, 0, 1, 2, 0, 1};
  for (int lane = 0; lane < 7; ++lane) {
    const Spectrum alone = bench.colour(of[lane], u, v);
    EXPECT_EQ(lane_of(mixed, lane).x, lane_of(alone, lane).x) << lane;
    EXPECT_EQ(lane_of(mixed, lane).z, lane_of(alone, lane).z) << lane;
  }
  EXPECT_EQ(lane_of(mixed, 7).x, 0);
}

TEST(Textures, CheckerboardSidesMayBeTextures) {
  scene::CheckerboardTexture inner;
  inner.colour0 = scene::Colour(2, 2, 2);
  inner.colour1 = scene::Colour({3, 4, 5}, 0);
  scene::CheckerboardTexture outer;
  outer.to_uv = {0.5F, 0, 0, 0, 0.5F, 0};
  outer.colour0 = scene::Colour({10, 10, 10}, 1);
  outer.colour1 = scene::Colour(7, 7, 7);
  const Bench bench({bitmap(Filter::kBilinear, Wrap::kRepeat), {inner, "", {}}, {outer, "", {}}},
                    {table_image()});
  EXPECT_EQ(bench.colour(2, 0.25F, 0.25F), (scene::Rgb{20, 20, 20}));
  EXPECT_EQ(bench.colour(2, 1.25F, 0.25F), (scene::Rgb{7, 7, 7}));
  const scene::Rgb leaf = bench.colour(0, 0.75F, 0.25F);
  const scene::Rgb through = bench.colour(2, 0.75F, 0.25F);
  EXPECT_FLOAT_EQ(through[0], 30 * leaf[0]);
  EXPECT_FLOAT_EQ(through[2], 50 * leaf[2]);
  // The slope of a bitmap is seen through it, and constant squares have none.
  const Gradient own = bench.gradient(2, Float(1.25F), Float(0.25F));
  EXPECT_EQ(lane_value(own.du, 0), 0);
  EXPECT_NE(lane_value(bench.gradient(2, Float(0.75F), Float(0.25F)).du, 0), 0);
}

TEST(Textures, LuminanceOfGreyIsExact) {
  scene::Image grey{2, 2, 1, std::vector<float>{1, 1, 1, 1}};
  const Bench bench({bitmap(Filter::kBilinear, Wrap::kRepeat)}, {grey});
  UniformLanes random(3);
  for (int round = 0; round < 20; ++round) {
    const auto point = Bench::at(random.next(), random.next());
    const Float value = bench.textures.luminance(Int(0), point, all_lanes());
    EXPECT_TRUE(all(value == Float(1.F)));
  }
}

// Two triangles over four vertices, then a sphere.
geometry::Primitives attribute_tables() {
  geometry::Primitives primitives;
  primitives.indices = {0, 1, 2, 1, 3, 2};
  primitives.triangle_count = 2;
  primitives.vertex_count = 4;
  primitives.attributes = {
      {"vertex_color", 3, false, {1, 0, 0, 0, 1, 0, 0, 0, 1, 2, 4, 8, 0, 0, 0, 0}},
      {"vertex_weight", 1, false, {1, 2, 3, 4, 0, 0, 0, 0}},
      {"face_color", 3, true, {0.1F, 0.2F, 0.3F, 0.4F, 0.5F, 0.6F, 0, 0, 0, 0}}};
  return primitives;
}

TEST(Textures, AttributesOfVerticesAndFaces) {
  const Bench bench({{scene::AttributeTexture{"vertex_color"}, "", {}},
                     {scene::AttributeTexture{"vertex_weight"}, "", {}},
                     {scene::AttributeTexture{"face_color"}, "", {}},
                     {scene::AttributeTexture{"missing"}, "", {}}},
                    {}, attribute_tables());
  const Int texture = Int(_mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 0));
  geometry::SurfacePoint point = Bench::at(Float(0.F), Float(0.F));
  point.primitive = Int(_mm256_setr_epi32(0, 1, 0, 1, 0, 1, 0, 2));
  point.b1 = Float(0.5F);
  point.b2 = Float(0.25F);
  const Spectrum colour = bench.textures.colour(texture, point, all_lanes());
  const auto expect = [&](int lane, double r, double g, double b) {
    EXPECT_NEAR(lane_of(colour, lane).x, r, 1e-6) << lane;
    EXPECT_NEAR(lane_of(colour, lane).y, g, 1e-6) << lane;
    EXPECT_NEAR(lane_of(colour, lane).z, b, 1e-6) << lane;
  };
  expect(0, 0.25, 0.5, 0.25);
  expect(1, 1, 2.25, 4.25);
  expect(2, 2, 2, 2);
  expect(3, 3.25, 3.25, 3.25);
  expect(4, 0.1, 0.2, 0.3);
  expect(5, 0.4, 0.5, 0.6);
  expect(6, 0, 0, 0);
  expect(7, 0, 0, 0);
}

}  // namespace
}  // namespace metrofarm::texture::test
