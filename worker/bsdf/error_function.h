// The inverse of the error function, lane by lane.
#pragma once

#include "math/lanes.h"

namespace metrofarm::bsdf {

// M. Giles 2012, "Approximating the erfinv function", single precision (table 5): polynomials in
// w = -log(1 - x^2), central and tail. Relative error below 4e-7. Requires: |x| < 1.
inline Float erf_inverse(Float x) {
  const Float w = -xsimd::log((Float(1.F) - x) * (Float(1.F) + x));
  const auto horner = [](Float at, const float(&c)[9]) {
    Float sum(c[0]);
    for (int i = 1; i < 9; ++i) sum = Float(c[i]) + sum * at;
    return sum;
  };
  static constexpr float kCentral[9] = {2.81022636e-08F,  3.43273939e-07F, -3.5233877e-06F,
                                        -4.39150654e-06F, 0.00021858087F,  -0.00125372503F,
                                        -0.00417768164F,  0.246640727F,    1.50140941F};
  static constexpr float kTail[9] = {-0.000200214257F, 0.000100950558F, 0.00134934322F,
                                     -0.00367342844F,  0.00573950773F,  -0.0076224613F,
                                     0.00943887047F,   1.00167406F,     2.83297682F};
  const Float central = horner(w - Float(2.5F), kCentral);
  const Mask far = w >= Float(5.F);
  if (none(far)) return central * x;
  const Float tail = horner(safe_sqrt(w) - Float(3.F), kTail);
  return select(far, tail, central) * x;
}

}  // namespace metrofarm::bsdf
