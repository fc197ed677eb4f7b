// Acceptance probabilities and the weights that follow from them.
#pragma once

#include "math/lanes.h"

namespace metrofarm::metropolis {

// Metropolis acceptance under a symmetric kernel: min(1, f_y / f_x). Requires: f_x > 0.
inline Float metropolis_acceptance(Float f_x, Float f_y) {
  return select(f_y >= f_x, Float(1.F), f_y / f_x);
}

// Acceptance of the second stage's z after y was rejected: min(1, ratio g_z / g_x), where g_x =
// f_x - f_y and g_z = f_z - f_y, or less than 0, are f (1 - a1) of x and z: the factors of Tierney
// and Mira 1999 whose quotient (1 - a1) / (1 - a1) would be one of near equals. Green and Mira 2001
// put f at the reverse proposal for f_y in g_z. ratio: of the first stage's densities, 1 where they
// cancel; it may be infinite. Requires: g_x > 0, which a rejection implies.
inline Float second_acceptance(Float g_x, Float g_z, Float ratio) {
  const Float scaled = ratio * g_z;
  const Float acceptance = select(scaled >= g_x, Float(1.F), scaled / g_x);
  return keep(g_z > Float(0.F), acceptance);
}

// Expected values (Veach 1997, section 11.4.2): an iteration records its states with the
// probabilities of ending up in each; they sum to 1. That a second stage runs has probability
// 1 - a1 by itself, so its weight is its acceptance as it stands, moved from the current state,
// whose weight may so become negative.
struct ExpectedWeights {
  Float current, first, second;
};
inline ExpectedWeights expected_weights(Float first, Float second) {
  return {Float(1.F) - first - second, first, second};
}

enum class LayerWeights { kTwoLayer, kKelemen };

// Two film layers, for a fixed constant c and large-step probability p: with
// m(f) = (f / c) / (f / c + p), the chain layer takes w m(f) F / f, the large-step layer
// (1 - m(f)) F / c. Both denominators are f + p c, so neither divides by zero nor overflows.
//
// Kelemen et al. 2002, section 3.4, for comparison: both kinds of sample go to the chain layer with
// the weight (w + [large step]) / (f / b + p), where c takes b's place for good.
struct LayerScales {
  float pc;  // p c
  float p;
  LayerWeights weights = LayerWeights::kTwoLayer;

  Float chain(Float weight, Float f) const { return weight / (f + Float(pc)); }
  Float large_step(Float f) const {
    return Float(weights == LayerWeights::kTwoLayer ? p : 1.F) / (f + Float(pc));
  }
};

}  // namespace metrofarm::metropolis
