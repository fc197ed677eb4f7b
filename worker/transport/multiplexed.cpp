#include "transport/multiplexed.h"

#include "base/check.h"
#include "emitter/lookup.h"

namespace metrofarm::transport {

using primary_space::Pair;

MultiplexedTracer::MultiplexedTracer(const Scene& scene, const sensor::Camera& camera,
                                     const BidirectionalSettings& settings,
                                     const RasterWindow& raster,
                                     const std::vector<double>& length_probabilities)
    : BidirectionalTracer(scene, camera, settings, raster) {
  std::vector<double> weights = length_probabilities;
  if (weights.size() > static_cast<size_t>(depth_limit())) weights.resize(depth_limit());
  METROFARM_CHECK(!weights.empty());
  cdf_.resize(weights.size());
  probability_.resize(weights.size());
  emitter::quantize_cdf(weights, cdf_, probability_);
}

uint32_t MultiplexedTracer::coordinate_of(int edges) const {
  const double middle = cdf_[edges - 1] - 0.5 * probability_[edges - 1];
  return static_cast<uint32_t>(middle * 0x1p32);
}

void MultiplexedTracer::trace(primary_space::SampleSource& source, const RasterWindow& window,
                              Mask lanes, Contribution& out) {
  const Pair u = source.pair(primary_space::kTechniqueSlot, lanes);
  const auto lengths = static_cast<int32_t>(cdf_.size());
  const Int index = emitter::find_in_cdf(cdf_.data(), Int(0), lengths, u.first, lanes).index;
  const Int edges = index + Int(1);
  const Float count = select(equal(edges, Int(1)), Float(1.F), to_float(edges + Int(1)));
  const Mask wanted = lanes & ~less(edges, Int(min_depth()));
  Technique technique{.all = false, .edges = edges, .light_vertices = truncate(u.second * count)};
  trace_technique(source, window, technique, wanted, out);
  out.edges = edges;
  out.light_vertices = technique.light_vertices;
  out.scale(keep(lanes, count / gather(probability_.data(), index, lanes)));
}

}  // namespace metrofarm::transport
