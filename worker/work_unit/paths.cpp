#include <algorithm>
#include <cmath>

#include "math/rng.h"
#include "primary_space/stratified_source.h"
#include "work_unit/splat_lanes.h"
#include "work_unit/units.h"

namespace metrofarm::work_unit {
namespace {

// A sample may be this many film units large: with 2^32 steps to the unit, 2^10 samples of that
// size still fit a film value.
constexpr float kLargestSample = 0x1p20F;

// What is traced, and where it goes.
struct Stream {
  std::unique_ptr<transport::Estimator> estimator;
  int layer;
  double unit;  // of the layer
};

// Traces blocks of cells for consecutive sample numbers.
class PathRun {
 public:
  PathRun(const Context& context, Stream stream, film::Film& film, const std::stop_token& stop)
      : context_(context),
        stop_(stop),
        estimator_(std::move(stream.estimator)),
        source_(rng_key(context.spec().seed, RngDomain::kPath)),
        splatter_(film, context.filter()),
        scale_(static_cast<float>(1 / stream.unit)),
        noise_(mix64(context.spec().seed)) {
    destination_.layer = stream.layer;
  }

  void run_blocks(uint64_t first, uint64_t last, const SampleRange& samples) {
    for (uint64_t block = first; block < last && !stop_.stop_requested(); ++block)
      run_block(block * kGroupSize, samples);
  }

  void run_block(uint64_t first_cell, const SampleRange& samples) {
    const uint64_t end = samples.first + samples.count;
    for (uint64_t k = samples.first; k < end && !stop_.stop_requested(); ++k) {
      destination_.half = static_cast<int>(k % film::kHalves);
      destination_.group = static_cast<int>(k % film::kStatisticsGroups);
      for (int i = 0; i < kGroupSize; i += kLanes) run_pack(first_cell + i, k);
    }
  }

  SegmentOutput finish() {
    SegmentOutput out;
    out.digest = splatter_.digest();
    out.anomalies = anomalies_;
    out.counts.path_evaluations = estimator_->costs().paths;
    out.counts.rays = estimator_->costs().rays;
    return out;
  }

 private:
  void run_pack(uint64_t first_cell, uint64_t k) {
    if (first_cell >= context_.cells()) return;
    const auto left = static_cast<int>(std::min<uint64_t>(kLanes, context_.cells() - first_cell));
    const uint64_t number = k * context_.cells() + first_cell;
    // A sequence for each pixel and half: the halves stay independent, as the error estimate takes
    // them to be.
    const uint64_t sequence = k % film::kHalves * context_.cells() + first_cell;
    source_.begin_sequences(number, sequence, static_cast<uint32_t>(k / film::kHalves));
    const Mask lanes = first_lanes(left);
    estimator_->trace(source_, context_.cell_windows(first_cell), lanes, found_);
    for (const diagnostics::Incident& incident : estimator_->incidents()) log(incident);
    splat(number, lanes);
  }

  void log(const diagnostics::Incident& incident) {
    anomalies_.count(incident.kind);
    if (anomalies_.wants_sample())
      anomalies_.keep({incident, replayable(source_.read_pairs(incident.lane))});
  }

  void splat(uint64_t number, Mask lanes) {
    for (size_t i = 0; i < found_.splats.size(); ++i) {
      const transport::Splat& s = found_.splats[i];
      const Mask lit = lanes & not_black(s.radiance);
      const Mask fits = max_component(s.radiance) * Float(scale_) < Float(kLargestSample);
      for (uint32_t rest = bits(lit & ~fits); rest != 0; rest &= rest - 1) {
        log({diagnostics::AnomalyKind::kOutOfRange, diagnostics::Place::kFilm, 0,
             static_cast<uint8_t>(__builtin_ctz(rest))});
      }
      uint64_t noise[kLanes];
      for (int lane = 0; lane < kLanes; ++lane) noise[lane] = mix64(noise_ + number + lane) + i;
      splat_lanes(splatter_, destination_, s, Float(scale_), lit & fits, noise);
    }
  }

  const Context& context_;
  const std::stop_token& stop_;
  std::unique_ptr<transport::Estimator> estimator_;
  transport::Contribution found_;
  primary_space::StratifiedSource source_;
  film::Splatter splatter_;
  film::Destination destination_;
  diagnostics::AnomalyLog anomalies_;
  float scale_;
  uint64_t noise_;
};

}  // namespace

SegmentOutput run_path_segment(const Context& context, uint32_t segment, const SampleRange& samples,
                               film::Film& film, const std::stop_token& stop) {
  PathRun run(context, {context.make_estimator(), 0, context.spec().unit}, film, stop);
  const uint64_t first = uint64_t(segment) * context.spec().blocks_per_segment;
  run.run_blocks(first, std::min(first + context.spec().blocks_per_segment, context.blocks()),
                 samples);
  SegmentOutput out = run.finish();
  out.counts.mutations = out.counts.path_evaluations;
  return out;
}

SegmentOutput run_direct_segment(const Context& context, uint32_t group, const SampleRange& samples,
                                 film::Film& film, const std::stop_token& stop) {
  PathRun run(context,
              {context.make_direct_estimator(), kDirectLayer, kDirectUnit * context.spec().unit},
              film, stop);
  const uint64_t groups = context.spec().chain_groups;
  run.run_blocks(group * context.blocks() / groups,
                 (group + uint64_t{1}) * context.blocks() / groups, samples);
  return run.finish();
}

}  // namespace metrofarm::work_unit
