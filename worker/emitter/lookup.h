// Sampling of tabulated distributions, all lanes in step.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "math/warp.h"

namespace metrofarm::emitter {

// Steps of the numbers that choose.
inline constexpr double kChoiceSteps = 0x1p24;

// Running sums of the weights over their total, in whole steps, of which the first `skipped` are
// left to others: `picks`, the differences, are then the exact probabilities. Every weight above
// zero gets at least one step. The last entry that such a weight leads to is exactly 1, so that
// nothing after it is ever found. Requires: fewer weights than half the steps that there are, some
// above zero.
inline void quantize_cdf(std::span<const double> weights, std::span<float> cdf,
                         std::span<float> picks, int32_t skipped = 0) {
  double total = 0;
  for (double w : weights) total += w;
  const double all = kChoiceSteps - skipped;
  const double spread = all - static_cast<double>(weights.size());
  std::vector<double> steps(weights.size());
  double used = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] > 0) steps[i] = 1 + std::floor(weights[i] / total * spread);
    used += steps[i];
  }
  // What rounding left over, less than a step per weight.
  steps[std::max_element(weights.begin(), weights.end()) - weights.begin()] += all - used;
  double sum = skipped;
  for (size_t i = 0; i < weights.size(); ++i) {
    sum += steps[i];
    cdf[i] = static_cast<float>(sum / kChoiceSteps);
    picks[i] = static_cast<float>(steps[i] / kChoiceSteps);
  }
}

struct Found {
  Int index;
  Float rest;  // where between the entry's ends u lies, in [0, 1)
};

// First of the `count` entries from `first` on (the result counts from there) that exceeds u.
// Requires: u < 1, and the last entry is 1.
inline Found find_in_cdf(const float* cdf, Int first, int32_t count, Float u, Mask lanes) {
  Int low(0);
  for (int32_t span = count; span > 1;) {
    const int32_t half = span / 2;
    const Float bound = gather(cdf, first + low + Int(half - 1), lanes);
    low = select(u >= bound, low + Int(half), low);
    span -= half;
  }
  const Mask later = lanes & ~equal(low, Int(0));
  const Float begin = gather(cdf, first + low - Int(1), later);
  const Float end = gather(cdf, first + low, lanes);
  const Float rest = (u - begin) / (end - begin);
  return {low, xsimd::min(rest, Float(kOneMinusEpsilon))};
}

// Distributed on [0, 1] with a density that is linear between `at_zero` and `at_one` (not negative,
// one above zero). The inverse of its cumulative distribution, in the form that cancels nothing.
inline Float sample_linear(Float at_zero, Float at_one, Float u) {
  const Float start = at_zero / (at_zero + at_one);
  const Float root = safe_sqrt(sqr(start) + u * (Float(1.F) - start - start));
  const Float x = u / (start + root);
  return select(u > Float(0.F), xsimd::min(x, Float(1.F)), Float(0.F));
}

}  // namespace metrofarm::emitter
