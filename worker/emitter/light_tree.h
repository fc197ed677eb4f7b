// A hierarchy of lights: chooses one with a probability close to what it could add to a point.
//
// Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting",
// without the splitting. Every inner node decides between its two children by their importance
// (intensity, distance, the angle out of their normals and the angle to the receiver's normal, all
// of them bounds for the whole child).
//
// Probabilities are whole numbers of steps, as many as the caller gives for all lights together.
// A node hands its steps on to its children and nothing is ever rounded afterwards: what pmf()
// states is exactly what choose() does. Each light keeps at least one step, so none that might
// shine is left out, whatever the bounds say; and a light's steps are consecutive, with
// neighbours in the tree next to it: a small step of the choice finds the same light or a near one.
#pragma once

#include <cstdint>
#include <vector>

#include "emitter/light_bounds.h"
#include "emitter/light_sample.h"

namespace metrofarm::emitter {

// Immutable; thread-safe.
class LightTree {
 public:
  // A light by the caller's number.
  struct Leaf {
    LightBounds bounds;
    int32_t light = 0;
  };

  // No tree at all.
  LightTree() = default;
  // Requires: two leaves or more, usable(), different lights below `light_count`.
  LightTree(std::vector<Leaf> leaves, size_t light_count);

  bool empty() const { return rows_.empty(); }
  int32_t leaf_count() const { return leaf_count_; }

  struct Choice {
    Int light;
    Int steps;  // of `steps`, in which this light is chosen
  };
  // The light that step `step`, counted from 0, chooses for the receiver. Requires: step < steps;
  // steps >= leaf_count().
  Choice choose(Int step, int32_t steps, const Receiver& receiver, Mask lanes) const;
  // In how many of the steps choose() chooses the light. 0 where the tree does not hold it.
  Int steps_of(Int light, int32_t steps, const Receiver& receiver, Mask lanes) const;

  uint64_t bytes() const;

 private:
  struct Children;

  int32_t build(std::vector<Leaf>& leaves, size_t first, size_t end, int level, uint32_t trail,
                LightBounds& bounds);
  void store_child(int32_t row, int side, const LightBounds& bounds, int32_t reference,
                   size_t count);
  Children children(Int row, const Receiver& receiver, Mask lanes) const;
  template <class GoesRight>
  Choice descend(int32_t steps, const Receiver& receiver, Mask lanes, GoesRight&& right) const;

  std::vector<float> rows_;     // kStride per inner node, the root first
  std::vector<int32_t> trail_;  // by light: bit i is set where the way turns right at level i
  std::vector<int32_t> held_;   // by light: -1 where it is in the tree, else 0
  int32_t leaf_count_ = 0;
  int levels_ = 0;
};

}  // namespace metrofarm::emitter
