// Multiplexed paths (Hachisuka et al. 2014, "Multiplexed Metropolis Light Transport"): each primary
// sample makes one path of one length by one bidirectional technique.
#pragma once

#include <vector>

#include "transport/bidirectional.h"

namespace metrofarm::transport {

// Techniques that make paths of so many edges: emission met by chance, light sampling and all
// connections, the camera's included. An emitter that the camera sees directly is only met.
constexpr int technique_count(int edges) {
  return edges == 1 ? 1 : edges + 1;
}

class MultiplexedTracer final : public BidirectionalTracer {
 public:
  // length_probabilities: with which lengths of 1, 2, .. edges are drawn; in any unit, none
  // negative, some above zero. Lengths beyond settings.max_depth are never drawn.
  MultiplexedTracer(const Scene& scene, const sensor::Camera& camera,
                    const BidirectionalSettings& settings, const RasterWindow& raster,
                    const std::vector<double>& length_probabilities);

  // A path's contribution over the probability of its length and technique.
  void trace(primary_space::SampleSource& source, const RasterWindow& window, Mask lanes,
             Contribution& out) override;

  // Exactly what is drawn, by edges less one.
  const std::vector<float>& length_probabilities() const { return probability_; }
  // A value of the length's coordinate that draws it, in 32-bit fixed point. Requires: its
  // probability is above zero.
  uint32_t coordinate_of(int edges) const;

 private:
  std::vector<float> cdf_;  // upper end of each length's part of [0, 1)
  std::vector<float> probability_;
};

}  // namespace metrofarm::transport
