// Unidirectional path tracing with light sampling and multiple importance sampling (Veach 1997,
// chapters 9 and 10; power heuristic with exponent 2), eight paths side by side.
//
// The path tracer draws from a SampleSource and does not know whether a chain or an independent
// sampler is behind it.
#pragma once

#include "sensor/camera.h"
#include "transport/estimator.h"
#include "transport/interaction.h"

namespace metrofarm::transport {

// How a path from the eye finds emitters.
enum class LightSampling { kMis, kEmitter, kBsdf };

struct PathSettings {
  LightSampling light_sampling = LightSampling::kMis;
  int max_depth = -1;  // edges; -1: no limit but kLongestPath
  int rr_depth = 5;    // first depth at which roulette may end a path
  bool hide_emitters = false;
  int min_depth = 1;  // paths of fewer edges bring nothing back and cost no shadow rays
};

class PathTracer final : public Estimator {
 public:
  PathTracer(const Scene& scene, const sensor::Camera& camera, const PathSettings& settings);

  void trace(primary_space::SampleSource& source, const RasterWindow& window, Mask lanes,
             Contribution& out) override;

 private:
  struct State;

  Interaction meet(State& path, primary_space::SampleSource& source, int depth);
  void add_environment(State& path, Mask missed, int depth);
  void add_emission(State& path, const Interaction& vertex, int depth);
  void add_light_sample(State& path, const Interaction& vertex, primary_space::SampleSource& source,
                        int depth);
  void scatter(State& path, const Interaction& vertex, primary_space::SampleSource& source,
               int depth);
  Float weight_of_hit(Float pdf_bsdf, Float pdf_light, Mask delta) const;

  const Scene& scene_;
  const sensor::Camera& camera_;
  PathSettings settings_;
  int depth_limit_;
};

}  // namespace metrofarm::transport
