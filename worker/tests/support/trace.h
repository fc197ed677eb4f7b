// Traces many independent paths through a scene and gathers what they bring back.
#pragma once

#include <vector>

#include "base/parallel.h"
#include "tests/support/lane_tools.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"
#include "transport/path_tracer.h"

namespace metrofarm::test {

// Radiance per tile of a grid x grid raster that covers the camera's view.
struct Traced {
  std::vector<Moments> tiles;
  Moments all;
  uint64_t bad = 0;  // values that are not finite
  std::vector<uint64_t> anomalies = std::vector<uint64_t>(diagnostics::kAnomalyKinds, 0);
};

inline Traced trace_paths(scene::SceneDescription description,
                          const transport::PathSettings& settings, uint64_t paths, uint64_t seed,
                          int grid = 1) {
  const FlushDenormals flush;
  const transport::Scene scene(std::move(description), "avx2");
  const sensor::Camera camera(scene.description().sensor, scene.description().film, grid, grid);
  transport::PathTracer tracer(scene, camera, settings);
  primary_space::IndependentSource source(rng_key(seed, RngDomain::kTest));
  const Float zero(0.F), size(static_cast<float>(grid));
  Traced out;
  out.tiles.resize(size_t(grid) * grid);
  for (uint64_t i = 0; i < paths; i += kLanes) {
    source.begin(i);
    const auto c = tracer.trace(source, {zero, zero, size, size}, all_lanes());
    for (const diagnostics::Incident& incident : tracer.incidents())
      ++out.anomalies[static_cast<size_t>(incident.kind)];
    for (int lane = 0; lane < kLanes; ++lane) {
      const double value = lane_value(luminance(c.radiance), lane);
      if (!std::isfinite(value)) {
        ++out.bad;
        continue;
      }
      const int x = std::min(static_cast<int>(lane_value(c.raster_x, lane)), grid - 1);
      const int y = std::min(static_cast<int>(lane_value(c.raster_y, lane)), grid - 1);
      out.tiles[size_t(y) * grid + x].add(value);
      out.all.add(value);
    }
  }
  return out;
}

}  // namespace metrofarm::test
