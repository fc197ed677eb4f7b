#include "tests/support/statistics.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace metrofarm::test {
namespace {

constexpr double kSmallestCell = 5;

// Regularized upper incomplete gamma function Q(a, x): the series for P below a + 1, Lentz's
// continued fraction above (Abramowitz and Stegun 6.5.29 and 6.5.31).
double gamma_q_series(double a, double x) {
  double term = 1 / a;
  double sum = term;
  for (double n = a + 1; term > sum * 1e-16; ++n) {
    term *= x / n;
    sum += term;
  }
  return 1 - sum * std::exp(-x + a * std::log(x) - std::lgamma(a));
}

double gamma_q_fraction(double a, double x) {
  double b = x + 1 - a;
  double c = 1e300;
  double d = 1 / b;
  double h = d;
  for (int i = 1; i < 10000; ++i) {
    const double an = -i * (i - a);
    b += 2;
    d = 1 / (an * d + b);
    c = b + an / c;
    h *= d * c;
    if (std::fabs(d * c - 1) < 1e-15) break;
  }
  return h * std::exp(-x + a * std::log(x) - std::lgamma(a));
}

struct Cell {
  double observed, expected;
};

// Cells in ascending order of expectation, the smallest merged until each is large enough.
std::vector<Cell> pooled(std::span<const double> observed, std::span<const double> expected) {
  std::vector<Cell> cells(observed.size());
  for (size_t i = 0; i < cells.size(); ++i) cells[i] = {observed[i], expected[i]};
  std::sort(cells.begin(), cells.end(),
            [](const Cell& a, const Cell& b) { return a.expected < b.expected; });
  size_t first = 0;
  while (first + 1 < cells.size() && cells[first].expected < kSmallestCell) {
    cells[first + 1].observed += cells[first].observed;
    cells[first + 1].expected += cells[first].expected;
    ++first;
  }
  cells.erase(cells.begin(), cells.begin() + static_cast<std::ptrdiff_t>(first));
  return cells;
}

testing::AssertionResult judge_difference(double difference, double error, double false_alarm,
                                          double slack) {
  const double excess = std::max(0.0, std::fabs(difference) - slack);
  // Without any variance there is nothing but arithmetic.
  const double p = error > 0 ? normal_p(excess / error) : excess > 0 ? 0.0 : 1.0;
  if (p >= false_alarm) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "difference " << difference << " with standard error "
                                     << error << ", p = " << p << " < " << false_alarm;
}

}  // namespace

double chi_square_p(double statistic, int degrees) {
  if (degrees <= 0 || statistic <= 0) return 1;
  const double a = 0.5 * degrees, x = 0.5 * statistic;
  return x < a + 1 ? gamma_q_series(a, x) : gamma_q_fraction(a, x);
}

double normal_p(double z) {
  return std::erfc(std::fabs(z) / std::sqrt(2.0));
}

double sidak(double rate, int tests) {
  return -std::expm1(std::log1p(-rate) / tests);
}

ChiSquare chi_square(std::span<const double> observed, std::span<const double> expected) {
  const std::vector<Cell> cells = pooled(observed, expected);
  ChiSquare result;
  for (const Cell& cell : cells) {
    const double difference = cell.observed - cell.expected;
    result.statistic += difference * difference / cell.expected;
  }
  result.degrees = static_cast<int>(cells.size()) - 1;
  result.p = chi_square_p(result.statistic, result.degrees);
  return result;
}

testing::AssertionResult follows(std::span<const double> observed, std::span<const double> expected,
                                 double false_alarm) {
  if (observed.size() != expected.size())
    return testing::AssertionFailure() << "histograms of different sizes";
  const double seen = std::accumulate(observed.begin(), observed.end(), 0.0);
  const double wanted = std::accumulate(expected.begin(), expected.end(), 0.0);
  if (!(std::fabs(seen - wanted) <= 1e-3 * seen))
    return testing::AssertionFailure() << seen << " counts, but " << wanted << " expected";
  const ChiSquare c = chi_square(observed, expected);
  if (c.p >= false_alarm) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "chi-square " << c.statistic << " with " << c.degrees
                                     << " degrees of freedom, p = " << c.p << " < " << false_alarm;
}

testing::AssertionResult has_mean(const Moments& sample, double expected, double false_alarm,
                                  double slack) {
  return judge_difference(sample.mean() - expected, sample.standard_error(), false_alarm, slack)
         << " (mean " << sample.mean() << ", expected " << expected << ")";
}

testing::AssertionResult same_mean(const Moments& a, const Moments& b, double false_alarm,
                                   double slack) {
  const double error = std::hypot(a.standard_error(), b.standard_error());
  return judge_difference(a.mean() - b.mean(), error, false_alarm, slack)
         << " (means " << a.mean() << " and " << b.mean() << ")";
}

}  // namespace metrofarm::test
