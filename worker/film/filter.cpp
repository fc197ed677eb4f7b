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

// Mitchell and Netravali 1988, "Reconstruction Filters in Computer Graphics", equation 8, for
// distances t in [0, 2).
template <class T>
T cubic(T t, T b, T c) {
  const T t2 = t * t;
  const T t3 = t2 * t;
  if (t < 1) return ((12 - 9 * b - 6 * c) * t3 + (-18 + 12 * b + 6 * c) * t2 + (6 - 2 * b)) / 6;
  return ((-b - 6 * c) * t3 + (6 * b + 30 * c) * t2 + (-12 * b - 48 * c) * t + (8 * b + 24 * c)) /
         6;
}

// sin(pi x) / (pi x)
template <class T>
T sinc(T x) {
  const T angle = std::numbers::pi_v<T> * x;
  return std::fabs(angle) < T(1e-4) ? 1 - angle * angle / 6 : std::sin(angle) / angle;
}

// Integral over [-r, r] of sinc(x) sinc(x / r) by Simpson's rule.
double lanczos_integral(double radius) {
  constexpr int kSteps = 2000;
  double sum = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double x = radius * i / kSteps;
    const double weight = i == 0 || i == kSteps ? 1 : i % 2 == 1 ? 4 : 2;
    sum += weight * sinc(x) * sinc(x / radius);
  }
  return 2 * sum * radius / (3 * kSteps);
}

double integral_of(const scene::Film& film) {
  switch (film.filter) {
    case ReconstructionFilter::kBox:
      return 2 * film.filter_radius;
    case ReconstructionFilter::kTent:
      return film.filter_radius;
    case ReconstructionFilter::kGaussian:
      return gaussian_integral(film.filter_radius, film.filter_stddev);
    case ReconstructionFilter::kMitchell:
    case ReconstructionFilter::kCatmullRom:
      return film.filter_radius / 2;  // 1 at the radius of 2 for which the polynomials are made
    case ReconstructionFilter::kLanczos:
      return lanczos_integral(film.filter_radius);
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
      at_radius_(std::exp(-radius_ * radius_ * inverse_variance2_)),
      b_(film.filter == ReconstructionFilter::kMitchell ? static_cast<float>(film.mitchell_b) : 0),
      c_(film.filter == ReconstructionFilter::kMitchell ? static_cast<float>(film.mitchell_c)
                                                        : 0.5F) {
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
    case ReconstructionFilter::kMitchell:
    case ReconstructionFilter::kCatmullRom:
      return scale_ * cubic(2 * d / radius_, b_, c_);
    case ReconstructionFilter::kLanczos:
      return scale_ * sinc(d) * sinc(d / radius_);
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
