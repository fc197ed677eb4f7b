#include "film/film.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "math/rng.h"
#include "tests/support/film_values.h"
#include "tests/support/statistics.h"

namespace metrofarm::film {
namespace {

using scene::ReconstructionFilter;

Filter filter_of(ReconstructionFilter kind, double radius) {
  scene::Film film;
  film.filter = kind;
  film.filter_radius = radius;
  return Filter(film);
}

const Filter kBox = filter_of(ReconstructionFilter::kBox, 0.5);

// H0: a splat's expectation is its value, even far below one step of fixed point. 200,000 splats of
// 0.3 steps and of -0.3 steps; z-test of the mean of the Bernoulli outcomes, rate 1e-6 each.
TEST(Splatter, DitherIsUnbiased) {
  for (double steps : {0.3, 2.75, -0.3}) {
    Film film({1, 1, 1});
    Splatter splatter(film, kBox);
    constexpr int kSplats = 200000;
    const auto v = static_cast<float>(steps / kFixedOne);
    const float rgb[3] = {v, v, v};
    for (int i = 0; i < kSplats; ++i) splatter.splat({}, 0.5F, 0.5F, rgb, mix64(i));
    const double fraction = steps - std::floor(steps);
    const double error = std::sqrt(fraction * (1 - fraction) / kSplats);
    const auto values = test::full_plane(film, 0);
    const auto cells = test::low_plane(film, 0);
    for (int c = 0; c < kChannels; ++c) {
      const double mean = double(values[c]) / kSplats;
      EXPECT_GT(test::normal_p((mean - steps) / error), 1e-6) << "channel " << c;
      const double low = double(cells[size_t(c) * kLowGrid * kLowGrid]) / kSplats;
      EXPECT_GT(test::normal_p((low - steps) / error), 1e-6) << "channel " << c;
    }
  }
}

TEST(Splatter, CountsGoToOnePixelUnfiltered) {
  const Filter wide = filter_of(ReconstructionFilter::kGaussian, 2);
  Film film({40, 20, 2});
  Splatter splatter(film, wide);
  const int64_t v[kChannels] = {int64_t{1} << 32, 7, 0};
  const Destination to{1, 1, 5};
  splatter.count(to, 39.9F, 19.0F, v);
  // None of these lies in the image.
  for (const auto& [x, y] : {std::pair{-0.1F, 3.F}, {40.F, 3.F}, {3.F, 20.F}, {-1e6F, -1e6F}})
    splatter.count(to, x, y, v);
  const std::vector<int64_t> full = test::full_plane(film, 3), low = test::low_plane(film, 11);
  const size_t pixel = 19 * 40 + 39;
  EXPECT_EQ(full[pixel * kChannels], v[0]);
  EXPECT_EQ(full[pixel * kChannels + 1], 7);
  EXPECT_EQ(std::count(full.begin(), full.end(), 0), 40 * 20 * kChannels - 2);
  // Cells are 3 x 2 pixels.
  EXPECT_EQ(low[9 * kLowGrid + 13], v[0]);
  EXPECT_EQ(low[kLowGrid * kLowGrid + 9 * kLowGrid + 13], 7);
  EXPECT_EQ(splatter.digest(), test::digest_from_planes(film));
}

// H0: the dithers of the channels are independent: both round up with probability 0.25. 100,000
// splats of half a step, rate 1e-6 per pair.
TEST(Splatter, ChannelsAreDitheredIndependently) {
  constexpr int kSplats = 100000;
  int both[3] = {};
  for (int i = 0; i < kSplats; ++i) {
    Film film({1, 1, 1});
    Splatter splatter(film, kBox);
    const auto half = static_cast<float>(0.5 / kFixedOne);
    const float rgb[3] = {half, half, half};
    splatter.splat({}, 0.5F, 0.5F, rgb, mix64(i));
    int64_t tile[kTileSize * kTileSize * kChannels];
    film.read_tile(0, 0, 0, tile);
    const auto up = [&](int c) { return tile[c * kTileSize * kTileSize] == 1; };
    for (int c = 0; c < 3; ++c) both[c] += up(c) && up((c + 1) % 3) ? 1 : 0;
  }
  for (int count : both) {
    const double z = (count - 0.25 * kSplats) / std::sqrt(kSplats * 0.25 * 0.75);
    EXPECT_GT(test::normal_p(z), 1e-6);
  }
}

TEST(Splatter, WholeValuesAreExact) {
  Film film({3, 2, 2});
  Splatter splatter(film, kBox);
  const float rgb[3] = {1, 0.5F, 0x1p-20F};
  for (int i = 0; i < 100; ++i) splatter.splat({1, 1, 3}, 2.25F, 1.75F, rgb, mix64(i));
  const auto plane = test::full_plane(film, 1 * 2 + 1);
  EXPECT_EQ(plane[5 * 3 + 0], int64_t{100} << 32);
  EXPECT_EQ(plane[5 * 3 + 1], int64_t{50} << 32);
  EXPECT_EQ(plane[5 * 3 + 2], int64_t{100} << 12);
  const auto low = test::low_plane(film, 3 * 2 + 1);
  EXPECT_EQ(low[1 * kLowGrid + 2], int64_t{100} << 32);
  for (int p : {0, 1, 2}) {
    for (int64_t v : test::full_plane(film, p)) EXPECT_EQ(v, 0);
  }
}

TEST(Splatter, ACoordinateThatRoundsUpToTheEdgeCountsInTheLastPixel) {
  Film film({4, 4, 1});
  Splatter splatter(film, kBox);
  const float rgb[3] = {1, 1, 1};
  splatter.splat({}, 4.F, 4.F, rgb, 1);
  EXPECT_EQ(test::full_plane(film, 0)[15 * 3], int64_t{1} << 32);
}

// Splats on a regular grid over the domain enlarged by the border: every pixel, also those at the
// edges, gets the same sum, the number of splats per pixel area.
TEST(Splatter, WideFiltersLoseNoEnergyAtTheEdges) {
  constexpr int kSize = 6, kPerAxis = 16;
  for (const Filter& filter :
       {filter_of(ReconstructionFilter::kTent, 1), filter_of(ReconstructionFilter::kGaussian, 2),
        filter_of(ReconstructionFilter::kGaussian, 3.5),
        filter_of(ReconstructionFilter::kMitchell, 2),
        filter_of(ReconstructionFilter::kCatmullRom, 2),
        filter_of(ReconstructionFilter::kLanczos, 3),
        filter_of(ReconstructionFilter::kBox, 1.25)}) {
    Film film({kSize, kSize, 1});
    Splatter splatter(film, filter);
    const int across = (kSize + 2 * filter.border()) * kPerAxis;
    const float rgb[3] = {1, 2, 3};
    for (int j = 0; j < across; ++j) {
      for (int i = 0; i < across; ++i) {
        const float x =
            (static_cast<float>(i) + 0.5F) / kPerAxis - static_cast<float>(filter.border());
        const float y =
            (static_cast<float>(j) + 0.5F) / kPerAxis - static_cast<float>(filter.border());
        splatter.splat({}, x, y, rgb, mix64(i * 4096 + j));
      }
    }
    const auto plane = test::full_plane(film, 0);
    for (size_t i = 0; i < plane.size(); ++i) {
      const double expected = kPerAxis * kPerAxis * static_cast<double>(i % 3 + 1);
      EXPECT_NEAR(double(plane[i]) / kFixedOne / expected, 1, 5e-3) << "value " << i;
    }
  }
}

// A splat at a pixel's corner and one whose neighbours get negative weights: fixed point holds both
// signs, and a pixel's sum is the product of the weights along both axes.
TEST(Splatter, NegativeLobesAreKept) {
  const Filter lanczos = filter_of(ReconstructionFilter::kLanczos, 3);
  Film film({12, 12, 1});
  Splatter splatter(film, lanczos);
  const float rgb[3] = {1, 0.5F, 3};
  splatter.splat({}, 6.25F, 5.5F, rgb, mix64(9));
  const auto plane = test::full_plane(film, 0);
  const Filter::Span columns = lanczos.span(6.25F), rows = lanczos.span(5.5F);
  int negative = 0;
  for (int j = 0; j < rows.count; ++j) {
    for (int i = 0; i < columns.count; ++i) {
      const double w = double(columns.weight[i]) * rows.weight[j];
      const size_t pixel = size_t(rows.first + j) * 12 + columns.first + i;
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(double(plane[3 * pixel + c]), w * rgb[c] * kFixedOne, 1);
      negative += plane[3 * pixel] < 0 ? 1 : 0;
    }
  }
  EXPECT_GT(negative, 2);
  EXPECT_EQ(splatter.digest(), test::digest_from_planes(film));
}

TEST(Splatter, StatisticsCountEachSplatOnceWhereItFalls) {
  const Filter gaussian = filter_of(ReconstructionFilter::kGaussian, 2);
  Film film({40, 20, 1});
  Splatter splatter(film, gaussian);
  const float rgb[3] = {1, 1, 1};
  splatter.splat({0, 0, 7}, 39.5F, 19.5F, rgb, 5);
  splatter.splat({0, 0, 7}, -0.5F, 3, rgb, 6);
  const auto low = test::low_plane(film, 7);
  // Cells are ceil(40 / 16) x ceil(20 / 16) = 3 x 2 pixels.
  EXPECT_EQ(low[size_t(19 / 2) * kLowGrid + 39 / 3], int64_t{1} << 32);
  int64_t sum = 0;
  for (size_t i = 0; i < low.size() / 3; ++i) sum += low[i];
  EXPECT_EQ(sum, int64_t{1} << 32);
}

TEST(Film, ClearForgetsEverything) {
  Film film({33, 5, 2});
  Splatter splatter(film, kBox);
  const float rgb[3] = {1, 1, 1};
  splatter.splat({1, 1, 15}, 32.5F, 4.5F, rgb, 3);
  film.clear();
  for (int64_t v : test::all_values(film)) EXPECT_EQ(v, 0);
}

TEST(Film, AnEmptyTileSaysSo) {
  Film film({65, 5, 1});
  Splatter splatter(film, kBox);
  const float rgb[3] = {1, 0, 0};
  splatter.splat({0, 1, 2}, 64.5F, 0.5F, rgb, 3);
  int64_t tile[kTileSize * kTileSize * kChannels];
  EXPECT_EQ(film.tiles_x(), 3);
  EXPECT_EQ(film.tiles_y(), 1);
  EXPECT_FALSE(film.read_tile(1, 0, 0, tile));
  EXPECT_TRUE(film.read_tile(1, 2, 0, tile));
  EXPECT_FALSE(film.read_tile(0, 2, 0, tile));
  EXPECT_FALSE(film.read_low(1, tile));
  EXPECT_TRUE(film.read_low(2, tile));
}

}  // namespace
}  // namespace metrofarm::film
