// Which light a receiver asks.
//
// Lights infinitely far away have a half of all choices to themselves wherever there are both, by
// power among them: what reaches the scene from there has no scale in common with the power of a
// lamp. Of the others a tree chooses by what they could add to the receiver. Without a tree to
// build, that is where no more than kFewLights are not infinitely far away, power decides.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emitter/light_sample.h"
#include "emitter/light_tree.h"

namespace metrofarm::emitter {

struct LightChoice {
  Int light = Int(0);
  Float probability = Float(0.F);
};

// Lights in proportion to their weight, wherever they are asked from.
class WeightTable {
 public:
  WeightTable() = default;
  // Requires: some weight is above zero. `skipped` of kChoiceSteps are left to others.
  explicit WeightTable(std::span<const double> weights, int32_t skipped = 0);

  bool empty() const { return cdf_.empty(); }
  // Requires: the choice is in [0, 1) and no step of it was skipped.
  LightChoice choose(Float choice, Mask lanes) const;
  Float probability(Int light, Mask lanes) const { return gather(pick_.data(), light, lanes); }
  float probability(size_t light) const { return pick_[light]; }
  uint64_t bytes() const { return (cdf_.capacity() + pick_.capacity()) * sizeof(float); }

 private:
  std::vector<float> cdf_;   // upper end of each light's part of [0, 1)
  std::vector<float> pick_;  // its length
};

// Immutable; thread-safe.
class LightSelection {
 public:
  // By light. A power of zero: never chosen.
  struct Light {
    double power = 0;  // by weight_of(), W
    bool infinitely_far = false;
    LightBounds bounds;  // of the others
  };

  LightSelection() = default;
  // Requires: some power is above zero.
  explicit LightSelection(const std::vector<Light>& lights);

  LightChoice choose(Float choice, const Receiver& receiver, Mask lanes) const;
  // With which choose() chooses the light.
  Float probability(Int light, const Receiver& receiver, Mask lanes) const;
  // Of a light infinitely far away the same for all receivers.
  float probability_infinitely_far(size_t light) const { return table_.probability(light); }

  bool has_tree() const { return !tree_.empty(); }
  uint64_t bytes() const { return tree_.bytes() + table_.bytes(); }

 private:
  LightTree tree_;
  int32_t tree_steps_ = 0;  // of kChoiceSteps, the first ones
  WeightTable table_;       // of the lights that are in no tree
};

}  // namespace metrofarm::emitter
