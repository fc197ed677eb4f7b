// The statistical instruments of the tests: chi-square, z and Welch tests that answer with a
// p-value or, given a false-alarm rate, with an AssertionResult.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <span>

namespace metrofarm::test {

// Probability that a chi-square variable of `degrees` degrees of freedom exceeds `statistic`.
double chi_square_p(double statistic, int degrees);

// Probability that |z| of a standard normal variable exceeds |z|.
double normal_p(double z);

// Rate at which each of `tests` independent tests may alarm so that the family alarms at `rate`.
double sidak(double rate, int tests);

struct ChiSquare {
  double statistic = 0;
  int degrees = 0;
  double p = 1;
};

// Pearson's test. Cells of fewer than five expected counts are pooled. Requires: observed and
// expected have the same length and, but for rounding, the same sum.
ChiSquare chi_square(std::span<const double> observed, std::span<const double> expected);

// H0: the counts were drawn with the expected frequencies. Fails where p < false_alarm.
testing::AssertionResult follows(std::span<const double> observed, std::span<const double> expected,
                                 double false_alarm);

// Mean and variance of what was added (Welford 1962).
class Moments {
 public:
  void add(double x) {
    ++count_;
    const double delta = x - mean_;
    mean_ += delta / static_cast<double>(count_);
    sum_squares_ += delta * (x - mean_);
  }
  uint64_t count() const { return count_; }
  double mean() const { return mean_; }
  double variance() const { return sum_squares_ / static_cast<double>(count_ - 1); }
  double standard_error() const { return std::sqrt(variance() / static_cast<double>(count_)); }

 private:
  uint64_t count_ = 0;
  double mean_ = 0;
  double sum_squares_ = 0;
};

// H0: the mean is `expected`, beyond a difference of `slack` that arithmetic may cause.
testing::AssertionResult has_mean(const Moments& sample, double expected, double false_alarm,
                                  double slack = 0);

// H0: both samples have the same mean, beyond `slack`.
testing::AssertionResult same_mean(const Moments& a, const Moments& b, double false_alarm,
                                   double slack = 0);

}  // namespace metrofarm::test
