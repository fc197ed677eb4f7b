#include "film/filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace metrofarm::film {
namespace {

using scene::ReconstructionFilter;

scene::Film film_with(ReconstructionFilter filter, double radius, double stddev = 0.5) {
  scene::Film film;
  film.filter = filter;
  film.filter_radius = radius;
  film.filter_stddev = stddev;
  return film;
}

// Integral over all raster positions of the weight that pixel 10 receives.
double integral_at_a_pixel(const Filter& filter) {
  constexpr int kSteps = 200000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const Filter::Span span = filter.span(static_cast<float>(20.0 * (i + 0.5) / kSteps));
    const int at = 10 - span.first;
    if (at >= 0 && at < span.count) sum += span.weight[at];
  }
  return sum * 20.0 / kSteps;
}

class FilterTest : public testing::TestWithParam<scene::Film> {};

TEST_P(FilterTest, IntegratesToOne) {
  EXPECT_NEAR(integral_at_a_pixel(Filter(GetParam())), 1, 2e-4);
}

TEST_P(FilterTest, ReachesNoFurtherThanItsBorder) {
  const Filter filter(GetParam());
  for (int i = 0; i < 1000; ++i) {
    const float x = 5 + static_cast<float>(i) / 1000;
    const Filter::Span span = filter.span(x);
    EXPECT_GE(span.first, 5 - std::max(filter.border(), 1));
    EXPECT_LE(span.first + span.count - 1, 5 + std::max(filter.border(), 1));
    for (int k = 0; k < span.count; ++k) EXPECT_GE(span.weight[k], 0);
  }
}

TEST_P(FilterTest, IsSymmetric) {
  const Filter filter(GetParam());
  for (float d : {0.125F, 0.25F, 0.375F}) {
    const Filter::Span right = filter.span(8.5F + d), left = filter.span(8.5F - d);
    EXPECT_FLOAT_EQ(right.weight[8 - right.first], left.weight[8 - left.first]);
  }
}

INSTANTIATE_TEST_SUITE_P(Filters, FilterTest,
                         testing::Values(film_with(ReconstructionFilter::kBox, 0.5),
                                         film_with(ReconstructionFilter::kBox, 1.7),
                                         film_with(ReconstructionFilter::kTent, 1),
                                         film_with(ReconstructionFilter::kTent, 2.5),
                                         film_with(ReconstructionFilter::kGaussian, 2, 0.5),
                                         film_with(ReconstructionFilter::kGaussian, 4, 1.3),
                                         film_with(ReconstructionFilter::kGaussian, 0.8, 0.5)));

TEST(Filter, OnlyTheBoxOfOnePixelNeedsNoBorder) {
  EXPECT_TRUE(Filter(film_with(ReconstructionFilter::kBox, 0.5)).is_pixel_box());
  EXPECT_EQ(Filter(film_with(ReconstructionFilter::kBox, 0.5)).border(), 0);
  EXPECT_FALSE(Filter(film_with(ReconstructionFilter::kTent, 0.5)).is_pixel_box());
  EXPECT_EQ(Filter(film_with(ReconstructionFilter::kTent, 1)).border(), 1);
  EXPECT_EQ(Filter(film_with(ReconstructionFilter::kGaussian, 2.1)).border(), 3);
}

TEST(Filter, TentFallsLinearly) {
  const Filter::Span s = Filter(film_with(ReconstructionFilter::kTent, 1)).span(3.75F);
  ASSERT_EQ(s.first, 3);
  EXPECT_FLOAT_EQ(s.weight[0], 0.75F);
  EXPECT_FLOAT_EQ(s.weight[1], 0.25F);
}

TEST(Filter, WhatDoesNotFitIsRefused) {
  EXPECT_TRUE(Filter::fits(19));
  EXPECT_FALSE(Filter::fits(20));
}

}  // namespace
}  // namespace metrofarm::film
