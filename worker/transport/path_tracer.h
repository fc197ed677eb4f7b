// Unidirectional path tracing with light sampling and multiple importance sampling (Veach 1997,
// chapters 9 and 10; power heuristic with exponent 2), eight paths side by side.
//
// The path tracer draws from a SampleSource and does not know whether a chain or an independent
// sampler is behind it.
#pragma once

#include <vector>

#include "diagnostics/anomalies.h"
#include "primary_space/sample_source.h"
#include "sensor/camera.h"
#include "transport/scene.h"

namespace metrofarm::transport {

enum class LightSampling { kMis, kEmitter, kBsdf };

struct PathSettings {
  LightSampling light_sampling = LightSampling::kMis;
  int max_depth = -1;  // edges; -1: no limit but kLongestPath
  int rr_depth = 5;    // first depth at which roulette may end a path
  bool hide_emitters = false;
};

// Maps the film pair's unit square to raster positions in pixels, per lane.
struct RasterWindow {
  Float x, y;  // upper left corner
  Float width, height;
};

// What a path brings back: one splat.
struct Contribution {
  Float raster_x = Float(0.F);  // pixels
  Float raster_y = Float(0.F);
  Spectrum radiance = splat(0.F);
};

struct PathCosts {
  uint64_t paths = 0;
  uint64_t rays = 0;
};

// One per thread: keeps costs and incidents.
class PathTracer {
 public:
  PathTracer(const Scene& scene, const sensor::Camera& camera, const PathSettings& settings);

  // Traces the active lanes. Bad contributions are zero and listed in incidents().
  Contribution trace(primary_space::SampleSource& source, const RasterWindow& window, Mask lanes);

  const PathCosts& costs() const { return costs_; }
  // Incidents of the last trace().
  const std::vector<diagnostics::Incident>& incidents() const { return incidents_; }

 private:
  struct State;
  struct Vertex;

  Vertex meet(State& path, primary_space::SampleSource& source, int depth);
  void show(State& path, Vertex& vertex, primary_space::SampleSource& source, int depth);
  void add_environment(State& path, Mask missed, int depth);
  void add_emission(State& path, const Vertex& vertex, int depth);
  void add_light_sample(State& path, const Vertex& vertex, primary_space::SampleSource& source,
                        int depth);
  Mask unoccluded(const Vertex& vertex, const emitter::LightSample& light, Mask lanes);
  void scatter(State& path, const Vertex& vertex, primary_space::SampleSource& source, int depth);
  void accumulate(State& path, const Spectrum& contribution, Mask lanes, diagnostics::Place place,
                  int depth);
  Float weight_of_hit(Float pdf_bsdf, Float pdf_light, Mask delta) const;

  const Scene& scene_;
  const sensor::Camera& camera_;
  PathSettings settings_;
  int depth_limit_;
  PathCosts costs_;
  std::vector<diagnostics::Incident> incidents_;
};

}  // namespace metrofarm::transport
