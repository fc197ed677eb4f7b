// Acceptance probabilities and the weights that follow from them.
#pragma once

#include "math/lanes.h"

namespace metrofarm::metropolis {

// Metropolis acceptance under a symmetric kernel: min(1, f_y / f_x). Requires: f_x > 0.
inline Float metropolis_acceptance(Float f_x, Float f_y) {
  return select(f_y >= f_x, Float(1.F), f_y / f_x);
}

// Expected values (Veach 1997, section 11.4.2): an iteration records both states with the
// probabilities of ending up in each; they sum to 1.
struct ExpectedWeights {
  Float current, proposal;
};
inline ExpectedWeights expected_weights(Float acceptance) {
  return {Float(1.F) - acceptance, acceptance};
}

// Two film layers, for a fixed constant c and large-step probability p: with
// m(f) = (f / c) / (f / c + p), the chain layer takes w m(f) F / f, the large-step layer
// (1 - m(f)) F / c. Both denominators are f + p c, so neither divides by zero nor overflows.
struct LayerScales {
  float pc;  // p c
  float p;

  Float chain(Float weight, Float f) const { return weight / (f + Float(pc)); }
  Float large_step(Float f) const { return Float(p) / (f + Float(pc)); }
};

}  // namespace metrofarm::metropolis
