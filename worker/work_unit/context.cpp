#include "work_unit/context.h"

#include <cmath>
#include <initializer_list>

#include "base/check.h"

namespace metrofarm::work_unit {
namespace {

constexpr int kLargestFilm = 32768;

std::string problem_with_proposals(const Spec& spec) {
  const std::optional<Error> problem = metropolis::problem_with(spec.proposals());
  return problem ? problem->message : "";
}

constexpr double kSumTolerance = 1e-9;

std::string problem_with_lengths(const Spec& spec) {
  const std::vector<double>& p = spec.length_probabilities;
  if (spec.bootstrap_samples % (uint64_t{2} * kLanes * spec.path.max_depth) != 0)
    return "bootstrap_samples must be a multiple of 16 max_depth";
  if (p.empty()) return "";
  if (p.size() != static_cast<size_t>(spec.path.max_depth))
    return "length_probabilities must have max_depth values";
  double sum = 0;
  for (double value : p) {
    if (!(value >= 0)) return "length_probabilities must not be negative";
    sum += value;
  }
  if (!(std::abs(sum - 1) <= kSumTolerance)) return "length_probabilities must sum to 1";
  return "";
}

bool bidirectional(const Spec& spec) {
  return spec.integrator == Integrator::kBdpt || spec.integrator == Integrator::kMmlt ||
         (spec.integrator == Integrator::kPssmlt && spec.under == Under::kBdpt);
}

std::string problem_with_paths(const Spec& spec) {
  if (spec.path.rr_depth < 1) return "rr_depth must be at least 1";
  if (spec.path.max_depth < -1) return "max_depth must be -1 or more";
  if (spec.integrator == Integrator::kMmlt &&
      (spec.path.max_depth < 1 || spec.path.max_depth > kLongestMultiplexedPath))
    return "max_depth must lie in 1..32 where the integrator is mmlt";
  if (bidirectional(spec) && spec.path.light_sampling != transport::LightSampling::kMis)
    return "light_sampling must be mis with bidirectional tracing, which has every technique";
  return "";
}

// The first complaint.
std::string first_of(std::initializer_list<std::string> problems) {
  for (const std::string& problem : problems)
    if (!problem.empty()) return problem;
  return "";
}

std::string problem_with_target(const Spec& spec) {
  const TargetMapValues& map = spec.target_map;
  if (map.side < 0 || map.side > kLargestMapSide ||
      map.values.size() != static_cast<size_t>(map.side) * map.side)
    return "target_map must have side * side values, side at most 64";
  for (float v : map.values)
    if (!(v > 0 && v <= 1)) return "target_map must have values in (0, 1]";
  if (!spec.direct_apart) return "";
  if (spec.path.max_depth >= 0 && spec.path.max_depth <= kLongestDirectPath)
    return "direct_sizes must be empty where max_depth leaves the chains nothing";
  if (spec.chain_groups < 1) return "chain_groups must be at least 1";
  return "";
}

std::string problem_with_steps(const Spec& spec) {
  const metropolis::Kernel& k = spec.kernel;
  if ((k.eye_step_probability > 0 || k.light_step_probability > 0) && !bidirectional(spec))
    return "kernel.eye_step_probability and light_step_probability need light subpaths";
  return "";
}

std::string problem_with_layers(const Spec& spec) {
  if (spec.technique_layers && spec.integrator != Integrator::kMmlt)
    return "layers must not have techniques unless the integrator is mmlt";
  return "";
}

std::string problem_with_chains(const Spec& spec) {
  return first_of({problem_with_proposals(spec), problem_with_steps(spec),
                   problem_with_target(spec), problem_with_layers(spec),
                   spec.integrator == Integrator::kMmlt ? problem_with_lengths(spec) : ""});
}

}  // namespace

metropolis::Proposals Spec::proposals() const {
  std::vector<metropolis::FrozenPair> frozen;
  if (integrator == Integrator::kMmlt)
    frozen.push_back({primary_space::kTechniqueSlot, true,
                      technique_coordinate == TechniqueCoordinate::kFrozen});
  return {kernel, delayed_rejection, frozen};
}

std::string problem_with(const Spec& spec) {
  if (spec.width < 1 || spec.width > kLargestFilm || spec.height < 1 || spec.height > kLargestFilm)
    return "width and height must lie in 1..32768";
  if (!(spec.unit > 0 && std::isfinite(spec.unit))) return "unit must be positive and finite";
  if (spec.bootstrap_samples == 0 || spec.bootstrap_samples % (uint64_t{2} * kGroupSize) != 0 ||
      spec.bootstrap_samples > kLargestBootstrap)
    return "bootstrap_samples must be an even multiple of 64, at most 2^32";
  if (spec.blocks_per_segment < 1) return "blocks_per_segment must be at least 1";
  if (std::string problem = sensor::problem_with(spec.shutter); !problem.empty()) return problem;
  if (std::string problem = problem_with_paths(spec); !problem.empty()) return problem;
  return runs_chains(spec.integrator) ? problem_with_chains(spec) : "";
}

Context::Context(const transport::Scene& scene, const Spec& spec)
    : scene_(scene),
      spec_(spec),
      camera_(scene.description().sensor, scene.description().film, spec.width, spec.height,
              sensor::Shutter(spec.shutter, spec.height),
              {scene.anything_moves(), double(scene.lights().scene_radius())}),
      filter_(scene.description().film),
      target_map_(spec.target_map, spec.width, spec.height),
      cells_x_(spec.width + 2 * filter_.border()),
      cells_y_(spec.height + 2 * filter_.border()) {
  METROFARM_CHECK(scene.stands_still() || scene.interval() == interval_of(spec));
}

motion::Interval interval_of(const Spec& spec) {
  return sensor::Shutter(spec.shutter, spec.height).interval();
}

int Context::image_layers() const {
  if (!runs_chains(spec_.integrator)) return 1;
  return spec_.direct_apart ? 3 : 2;
}

film::FilmShape Context::film_shape() const {
  int layers = image_layers();
  if (spec_.acceptance_layer) ++layers;
  if (spec_.technique_layers) layers += 2 * kTechniqueImages;
  return {spec_.width, spec_.height, layers};
}

transport::RasterWindow Context::whole_raster() const {
  const auto corner = static_cast<float>(-filter_.border());
  return {Float(corner), Float(corner), Float(static_cast<float>(cells_x_)),
          Float(static_cast<float>(cells_y_))};
}

transport::RasterWindow Context::cell_windows(uint64_t first) const {
  alignas(32) float x[kLanes], y[kLanes];
  for (int lane = 0; lane < kLanes; ++lane) {
    const uint64_t cell = first + lane;
    x[lane] = static_cast<float>(static_cast<int>(cell % cells_x_) - filter_.border());
    y[lane] = static_cast<float>(static_cast<int>(cell / cells_x_) - filter_.border());
  }
  return {Float::load_aligned(x), Float::load_aligned(y), Float(1.F), Float(1.F)};
}

int Context::min_depth() const {
  return spec_.direct_apart ? kLongestDirectPath + 1 : 1;
}

transport::BidirectionalSettings Context::bidirectional_settings() const {
  return {spec_.path.max_depth, spec_.path.rr_depth, spec_.path.hide_emitters, min_depth()};
}

std::unique_ptr<transport::MultiplexedTracer> Context::make_multiplexed(Lengths lengths) const {
  std::vector<double> probabilities = spec_.length_probabilities;
  if (lengths == Lengths::kUniform || probabilities.empty())
    probabilities.assign(spec_.path.max_depth, 1.0);
  return std::make_unique<transport::MultiplexedTracer>(scene_, camera_, bidirectional_settings(),
                                                        whole_raster(), probabilities);
}

std::unique_ptr<transport::Estimator> Context::make_estimator(Lengths lengths) const {
  const bool over_bdpt = spec_.integrator == Integrator::kPssmlt && spec_.under == Under::kBdpt;
  if (spec_.integrator == Integrator::kMmlt) return make_multiplexed(lengths);
  if (spec_.integrator == Integrator::kBdpt || over_bdpt) {
    return std::make_unique<transport::BidirectionalTracer>(
        scene_, camera_, bidirectional_settings(), whole_raster());
  }
  transport::PathSettings settings = spec_.path;
  settings.min_depth = min_depth();
  return std::make_unique<transport::PathTracer>(scene_, camera_, settings);
}

std::unique_ptr<transport::Estimator> Context::make_direct_estimator() const {
  transport::PathSettings settings = spec_.path;
  settings.light_sampling = transport::LightSampling::kMis;
  settings.max_depth = kLongestDirectPath;
  return std::make_unique<transport::PathTracer>(scene_, camera_, settings);
}

}  // namespace metrofarm::work_unit
