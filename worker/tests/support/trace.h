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

// Primary samples evaluated by what make(scene, camera, raster) returns. A tile's samples are all
// primary samples, with what they bring to it, in units in which its mean is the mean radiance.
template <class Make>
Traced trace_with(scene::SceneDescription description, Make&& make, uint64_t paths, uint64_t seed,
                  int grid = 1) {
  const FlushDenormals flush;
  const transport::Scene scene(std::move(description), "avx2");
  const sensor::Camera camera(scene.description().sensor, scene.description().film, grid, grid);
  const Float zero(0.F), size(static_cast<float>(grid));
  const transport::RasterWindow raster{zero, zero, size, size};
  const std::unique_ptr<transport::Estimator> estimator = make(scene, camera, raster);
  primary_space::IndependentSource source(rng_key(seed, RngDomain::kTest));
  Traced out;
  out.tiles.resize(size_t(grid) * grid);
  transport::Contribution c;
  for (uint64_t i = 0; i < paths; i += kLanes) {
    source.begin(i);
    estimator->trace(source, raster, all_lanes(), c);
    for (const diagnostics::Incident& incident : estimator->incidents())
      ++out.anomalies[static_cast<size_t>(incident.kind)];
    for (int lane = 0; lane < kLanes; ++lane) {
      std::vector<double> found(out.tiles.size(), 0.0);
      for (const transport::Splat& s : c.splats) {
        const double value = lane_value(luminance(s.radiance), lane);
        if (!std::isfinite(value)) {
          ++out.bad;
          continue;
        }
        if (value == 0) continue;  // it may have no place
        const int x = std::min(static_cast<int>(lane_value(s.raster_x, lane)), grid - 1);
        const int y = std::min(static_cast<int>(lane_value(s.raster_y, lane)), grid - 1);
        found[size_t(y) * grid + x] += value;
      }
      double sum = 0;
      for (size_t t = 0; t < found.size(); ++t) {
        out.tiles[t].add(found[t] * grid * grid);
        sum += found[t];
      }
      out.all.add(sum);
    }
  }
  return out;
}

inline Traced trace_paths(scene::SceneDescription description,
                          const transport::PathSettings& settings, uint64_t paths, uint64_t seed,
                          int grid = 1) {
  const auto make = [&](const transport::Scene& scene, const sensor::Camera& camera,
                        const transport::RasterWindow&) {
    return std::make_unique<transport::PathTracer>(scene, camera, settings);
  };
  return trace_with(std::move(description), make, paths, seed, grid);
}

}  // namespace metrofarm::test
