// What a chain knows of its target: the scalar it samples in proportion to, and an opaque payload
// that the target splats when told to. Rendering is one target; tests use analytic ones.
#pragma once

#include <cstdint>

#include "primary_space/sample_source.h"

namespace metrofarm::metropolis {

// The two film layers: samples weighted by the chains, and independent samples (large steps).
enum class Layer { kChain = 0, kLargeStep = 1 };

// The states that exist side by side in an iteration, each with a payload.
enum class Which { kCurrent, kProposal, kSecond };
inline constexpr int kStates = 3;

// What became of the first stage of an iteration, in every lane.
struct FirstStage {
  Mask large;  // large steps
  Mask accepted;
  Float acceptance;  // probability
};

class Target {
 public:
  virtual ~Target() = default;

  // f at the points that `source` describes, in these lanes: finite and not negative. What was
  // found there becomes the payload of `into`; other lanes keep theirs, and their f is arbitrary.
  virtual Float evaluate(primary_space::SampleSource& source, Which into, Mask lanes) = 0;
  // In these lanes the payload of `from` becomes the current state's.
  virtual void accept(Which from, Mask lanes) = 0;
  // Adds scale times the payload to a layer. serial: unique per call and lane within a chain.
  virtual void record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) = 0;
  // Tells of the proposals, at whose points f was just evaluated.
  virtual void observe(const FirstStage& /*stage*/) {}
};

}  // namespace metrofarm::metropolis
