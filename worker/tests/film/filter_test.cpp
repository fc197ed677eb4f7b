#include "film/filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
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
  }
}

TEST_P(FilterTest, HasNegativeLobesOnlyWhereItsKindDoes) {
  const auto kind = GetParam().filter;
  const bool positive = kind == ReconstructionFilter::kBox || kind == ReconstructionFilter::kTent ||
                        kind == ReconstructionFilter::kGaussian;
  const Filter filter(GetParam());
  float smallest = 0;
  for (int i = 0; i < 1000; ++i) {
    const Filter::Span span = filter.span(5 + static_cast<float>(i) / 1000);
    for (int k = 0; k < span.count; ++k) smallest = std::min(smallest, span.weight[k]);
  }
  EXPECT_EQ(smallest < 0, !positive);
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
                                         film_with(ReconstructionFilter::kGaussian, 0.8, 0.5),
                                         film_with(ReconstructionFilter::kMitchell, 2),
                                         film_with(ReconstructionFilter::kMitchell, 3),
                                         film_with(ReconstructionFilter::kCatmullRom, 2),
                                         film_with(ReconstructionFilter::kLanczos, 2),
                                         film_with(ReconstructionFilter::kLanczos, 3)));

// The shape of a filter, from its weights at one pixel: proportional to its value at distance d.
float value_at(const Filter& filter, float d) {
  const Filter::Span span = filter.span(10.5F + d);
  const int at = 10 - span.first;
  return at >= 0 && at < span.count ? span.weight[at] : 0;
}

struct Shape {
  scene::Film film;
  double at_zero;              // value at distance 0
  std::array<double, 6> rest;  // at kDistances
};
constexpr std::array<float, 6> kDistances = {0.25F, 0.5F, 0.75F, 1.5F, 1.9F, 2.5F};

// As mitsuba.load_dict({"type": ...}).eval(d) of Mitsuba 3.9.1 gives them.
TEST(Filter, HasTheShapeThatMitsubaGivesIt) {
  scene::Film sharp = film_with(ReconstructionFilter::kMitchell, 2);
  sharp.mitchell_b = 0.2;
  sharp.mitchell_c = 0.5;
  const Shape shapes[] = {
      {film_with(ReconstructionFilter::kMitchell, 2),
       0.888889,
       {0.782118, 0.534722, 0.256076, -0.034722, -0.002944, 0}},
      {sharp, 0.933333, {0.820833, 0.558333, 0.258333, -0.058333, -0.004466, 0}},
      {film_with(ReconstructionFilter::kCatmullRom, 2),
       1,
       {0.867188, 0.5625, 0.226562, -0.0625, -0.0045, 0}},
      {film_with(ReconstructionFilter::kLanczos, 3),
       1,
       {0.890067, 0.607927, 0.27019, -0.135095, -0.02377, 0.024317}},
      {film_with(ReconstructionFilter::kLanczos, 2),
       1,
       {0.877354, 0.573159, 0.235347, -0.063684, -0.002714, 0}}};
  for (const Shape& shape : shapes) {
    const Filter filter(shape.film);
    for (size_t i = 0; i < kDistances.size(); ++i) {
      EXPECT_NEAR(value_at(filter, kDistances[i]) / value_at(filter, 0) * shape.at_zero,
                  shape.rest[i], 2e-6)
          << "distance " << kDistances[i];
    }
  }
}

// The cubics weigh all pixels together by 1 wherever a splat falls.
TEST(Filter, CubicsPartitionUnity) {
  for (auto kind : {ReconstructionFilter::kMitchell, ReconstructionFilter::kCatmullRom}) {
    const Filter filter(film_with(kind, 2));
    for (int i = 0; i < 500; ++i) {
      const Filter::Span span = filter.span(7 + static_cast<float>(i) / 500);
      double sum = 0;
      for (int k = 0; k < span.count; ++k) sum += span.weight[k];
      EXPECT_NEAR(sum, 1, 3e-6);
    }
  }
}

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
