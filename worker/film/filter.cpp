#include "film/filter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/check.h"

namespace metrofarm::film {

using scene::ReconstructionFilter;

namespace {

// Integral over [-r, r] of exp(-x^2 / (2 s^2)) - exp(-r^2 / (2 s^2)).
double gaussian_integral(double radius, double stddev) {
  const double bell =
      stddev * std::sqrt(2 * std::numbers::pi) * std::erf(radius / (stddev * std::numbers::sqrt2));
  return bell - 2 * radius * std::exp(-radius * radius / (2 * stddev * stddev));
}

double integral_of(const scene::Film& film) {
  switch (film.filter) {
    case ReconstructionFilter::kBox:
      return 2 * film.filter_radius;
    case ReconstructionFilter::kTent:
      return film.filter_radius;
    case ReconstructionFilter::kGaussian:
      return gaussian_integral(film.filter_radius, film.filter_stddev);
  }
  return 1;
}

}  // namespace

Filter::Filter(const scene::Film& film)
    : kind_(film.filter),
      is_pixel_box_(film.filter == ReconstructionFilter::kBox && film.filter_radius == 0.5),
      border_(is_pixel_box_ ? 0 : static_cast<int>(std::ceil(film.filter_radius))),
      radius_(static_cast<float>(film.filter_radius)),
      scale_(static_cast<float>(1 / integral_of(film))),
      inverse_variance2_(static_cast<float>(1 / (2 * film.filter_stddev * film.filter_stddev))),
      at_radius_(std::exp(-radius_ * radius_ * inverse_variance2_)) {
  METROFARM_CHECK(fits(film.filter_radius));
}

float Filter::value(float distance) const {
  const float d = std::fabs(distance);
  if (d >= radius_) return 0;
  switch (kind_) {
    case ReconstructionFilter::kBox:
      return scale_;
    case ReconstructionFilter::kTent:
      return scale_ * (1 - d / radius_);
    case ReconstructionFilter::kGaussian:
      return scale_ * std::max(0.F, std::exp(-d * d * inverse_variance2_) - at_radius_);
  }
  return 0;
}

Filter::Span Filter::span(float x) const {
  Span s;
  // Pixel i has its center at i + 0.5 and is reached from within the radius.
  s.first = static_cast<int>(std::ceil(x - radius_ - 0.5F));
  const int last = static_cast<int>(std::floor(x + radius_ - 0.5F));
  s.count = std::min(last - s.first + 1, kMaxReach);
  for (int i = 0; i < s.count; ++i) s.weight[i] = value(static_cast<float>(s.first + i) + 0.5F - x);
  return s;
}

}  // namespace metrofarm::film
