#include "transport/estimator.h"

namespace metrofarm::transport {

void Contribution::add(size_t i, const Splat& s, Mask lanes) {
  if (i >= splats.size()) splats.resize(i + 1);
  Splat& mine = splats[i];
  mine.raster_x = select(lanes, s.raster_x, mine.raster_x);
  mine.raster_y = select(lanes, s.raster_y, mine.raster_y);
  mine.radiance = mine.radiance + keep(lanes, s.radiance);
}

Spectrum Contribution::total() const {
  Spectrum sum = splats[0].radiance;
  for (size_t i = 1; i < splats.size(); ++i) sum = sum + splats[i].radiance;
  return sum;
}

void Contribution::take(const Contribution& other, Mask lanes) {
  if (splats.size() < other.splats.size()) splats.resize(other.splats.size());
  for (size_t i = 0; i < splats.size(); ++i) {
    if (i < other.splats.size()) {
      const Splat& theirs = other.splats[i];
      splats[i].raster_x = select(lanes, theirs.raster_x, splats[i].raster_x);
      splats[i].raster_y = select(lanes, theirs.raster_y, splats[i].raster_y);
      splats[i].radiance = select(lanes, theirs.radiance, splats[i].radiance);
    } else {
      splats[i].radiance = keep(~lanes, splats[i].radiance);
    }
  }
  edges = select(lanes, other.edges, edges);
  light_vertices = select(lanes, other.light_vertices, light_vertices);
  while (splats.size() > 1 && none(not_black(splats.back().radiance))) splats.pop_back();
}

void Contribution::scale(Float factor) {
  for (Splat& s : splats) s.radiance = s.radiance * factor;
}

void Estimator::expose(const sensor::Camera& camera, Contribution& out) {
  const float exposure = camera.shutter().exposure();
  if (exposure != 1) out.scale(Float(exposure));
}

void Estimator::begin(Mask lanes, Contribution& out) {
  incidents_.clear();
  costs_.paths += __builtin_popcount(bits(lanes));
  out.reset();
}

Spectrum Estimator::quarantine(const Spectrum& contribution, Mask lanes, diagnostics::Place place,
                               int depth) {
  const Mask good = diagnostics::sound(contribution);
  if (any(lanes & ~good))
    diagnostics::report(lanes & ~good, contribution, place, depth, incidents_);
  return keep(lanes & good, contribution);
}

}  // namespace metrofarm::transport
