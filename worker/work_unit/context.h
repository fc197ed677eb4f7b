// What all units of work of one job share: the scene, and the resolved spec as the renderer needs
// it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/result.h"
#include "film/film.h"
#include "metropolis/acceptance.h"
#include "metropolis/delayed_rejection.h"
#include "metropolis/stays.h"
#include "metropolis/target.h"
#include "transport/multiplexed.h"
#include "transport/path_tracer.h"
#include "transport/scene.h"
#include "work_unit/target_map.h"

namespace metrofarm::work_unit {

enum class Integrator { kPath, kPssmlt, kBdpt, kMmlt };
// What the chains of kPssmlt run over.
enum class Under { kPath, kBdpt };
// What small steps of kMmlt do to the coordinate that chooses a technique.
enum class TechniqueCoordinate { kFrozen, kMutated };

// See metrofarm.job.v1.ResolvedSpec.
struct Spec {
  Integrator integrator = Integrator::kPath;
  Under under = Under::kPath;
  transport::PathSettings path;
  int width = 0;
  int height = 0;
  uint64_t seed = 0;
  uint64_t bootstrap_samples = 65536;  // both halves together
  metropolis::Kernel kernel;
  metropolis::DelayedRejection delayed_rejection;
  metropolis::LayerWeights layer_weights = metropolis::LayerWeights::kTwoLayer;
  TechniqueCoordinate technique_coordinate = TechniqueCoordinate::kFrozen;
  // kMmlt: with which paths of 1, 2, .. edges are drawn by large steps, which alone change the
  // length; empty while the bootstrap runs.
  std::vector<double> length_probabilities;
  // Of the chains; the rest is left to independent paths in a layer of its own.
  bool direct_apart = false;
  uint32_t chain_groups = 0;
  TargetMapValues target_map;
  sensor::ShutterSettings shutter;
  // Layers of the film beside the image: see metrofarm.job.v1.DiagnosticLayer.
  bool acceptance_layer = false;
  bool technique_layers = false;  // kMmlt
  double unit = 1;
  uint32_t blocks_per_segment = 1;

  metropolis::Proposals proposals() const;
};

// Paths of so many edges and fewer are direct light.
inline constexpr int kLongestDirectPath = 2;
// Its layer, and that layer's unit in units of the film: direct light may be far brighter.
inline constexpr int kDirectLayer = 2;
inline constexpr double kDirectUnit = 4096;

// Images by technique: of paths with 0, 1, .. light vertices, the last with all that have more.
inline constexpr int kTechniqueImages = 5;

// Chains, or path samples, that are run side by side and handed out together.
inline constexpr int kGroupSize = 64;
inline constexpr uint64_t kLargestBootstrap = uint64_t{1} << 32;
inline constexpr int kPacksPerGroup = kGroupSize / kLanes;
// Edges: each length takes a share of the bootstrap.
inline constexpr int kLongestMultiplexedPath = 32;

inline bool runs_chains(Integrator i) {
  return i == Integrator::kPssmlt || i == Integrator::kMmlt;
}

// What is wrong with a spec, empty if nothing is.
std::string problem_with(const Spec& spec);

// The time that the scene has to be made for.
motion::Interval interval_of(const Spec& spec);

// Immutable; shared by all threads.
class Context {
 public:
  // Requires: problem_with(spec) is empty, the scene's filter fits and its interval is that of
  // interval_of(spec), unless the scene stands still.
  Context(const transport::Scene& scene, const Spec& spec);

  const transport::Scene& scene() const { return scene_; }
  const Spec& spec() const { return spec_; }
  const sensor::Camera& camera() const { return camera_; }
  const film::Filter& filter() const { return filter_; }
  const TargetMap& target_map() const { return target_map_; }
  film::FilmShape film_shape() const;
  // Requires: the spec has such layers. technique: below kTechniqueImages.
  int acceptance_layer() const { return image_layers(); }
  int technique_layer(int technique, metropolis::Layer of) const {
    return image_layers() + (spec_.acceptance_layer ? 1 : 0) + 2 * technique + static_cast<int>(of);
  }

  // The sampled part of the raster: the image and the filter's border.
  transport::RasterWindow whole_raster() const;

  // Cells of one pixel each that cover the sampled raster, in scanline order.
  uint64_t cells() const { return uint64_t(cells_x_) * cells_y_; }
  uint64_t blocks() const { return (cells() + kGroupSize - 1) / kGroupSize; }
  // Raster windows of the eight cells from `first`.
  transport::RasterWindow cell_windows(uint64_t first) const;

  // Lengths of multiplexed paths: drawn as the spec says or, for the bootstrap, all alike.
  enum class Lengths { kUniform, kAsResolved };
  // What the spec asks for, for one thread.
  std::unique_ptr<transport::Estimator> make_estimator(
      Lengths lengths = Lengths::kAsResolved) const;
  // Light that arrives over at most one bounce, for one thread.
  std::unique_ptr<transport::Estimator> make_direct_estimator() const;
  // Requires: the integrator is kMmlt.
  std::unique_ptr<transport::MultiplexedTracer> make_multiplexed(Lengths lengths) const;

 private:
  int min_depth() const;     // of the chains' paths
  int image_layers() const;  // of the film
  transport::BidirectionalSettings bidirectional_settings() const;

  const transport::Scene& scene_;
  Spec spec_;
  sensor::Camera camera_;
  film::Filter filter_;
  TargetMap target_map_;
  int cells_x_, cells_y_;
};

// First-stage proposals, and those accepted, by a small number.
struct Shares {
  // Greater numbers count as the largest.
  static constexpr int kLargest = 32;

  void add(Int numbers, uint32_t accepted_lanes) {
    alignas(32) int32_t at[kLanes];
    xsimd::min(numbers, Int(kLargest)).store_aligned(at);
    for (int lane = 0; lane < kLanes; ++lane) {
      ++proposed[at[lane]];
      accepted[at[lane]] += accepted_lanes >> lane & 1;
    }
  }

  std::array<uint64_t, kLargest + 1> proposed{}, accepted{};
};

// Counts of one segment; equal work gives equal counts.
struct Counts {
  uint64_t mutations = 0;
  uint64_t path_evaluations = 0;
  uint64_t rays = 0;
  uint64_t large_steps = 0, large_accepted = 0;
  uint64_t small_steps = 0, small_accepted = 0;
  uint64_t subpath_steps = 0, subpath_accepted = 0;
  // Second stages after rejected small steps, and after rejected large ones.
  uint64_t second_stages = 0, second_accepted = 0;
  uint64_t second_after_large = 0, second_after_large_accepted = 0;
  uint64_t coordinates = 0;  // that the proposals of all stages asked for
  // By edges and by light vertices, see transport::Contribution; the latter multiplexed only.
  Shares lengths, techniques;
  metropolis::StayCounts stays;

  // What independent paths beside the chains cost.
  void add_costs(const Counts& o) {
    path_evaluations += o.path_evaluations;
    rays += o.rays;
  }
};

}  // namespace metrofarm::work_unit
