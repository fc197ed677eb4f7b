// What a chain knows of its target: the scalar it samples in proportion to, and an opaque payload
// that the target splats when told to. Rendering is one target; tests use analytic ones.
#pragma once

#include <cstdint>

#include "primary_space/sample_source.h"

namespace metrofarm::metropolis {

// The two film layers: samples weighted by the chains, and independent samples (large steps).
enum class Layer { kChain = 0, kLargeStep = 1 };

enum class Which { kCurrent, kProposal };

class Target {
 public:
  virtual ~Target() = default;

  // f at the points that `source` describes: finite and not negative. What was found there becomes
  // the proposal's payload.
  virtual Float evaluate(primary_space::SampleSource& source) = 0;
  // In these lanes the proposal's payload becomes the current state's.
  virtual void accept(Mask lanes) = 0;
  // Adds scale times the payload to a layer. serial: unique per call and lane within a chain.
  virtual void record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) = 0;
};

}  // namespace metrofarm::metropolis
