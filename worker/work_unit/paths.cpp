#include <algorithm>
#include <cmath>

#include "math/rng.h"
#include "primary_space/stratified_source.h"
#include "work_unit/units.h"

namespace metrofarm::work_unit {
namespace {

// A sample may be this many film units large: with 2^32 steps to the unit, 2^10 samples of that
// size still fit a film value.
constexpr float kLargestSample = 0x1p20F;

// Traces one segment's cells for consecutive sample numbers.
class PathRun {
 public:
  PathRun(const Context& context, film::Film& film)
      : context_(context),
        tracer_(context.scene(), context.camera(), context.spec().path),
        source_(rng_key(context.spec().seed, RngDomain::kPath)),
        splatter_(film, context.filter()),
        scale_(static_cast<float>(1 / context.spec().unit)),
        noise_(mix64(context.spec().seed)) {}

  void run_block(uint64_t first_cell, const PathRange& range) {
    for (uint64_t k = range.first_sample; k < range.first_sample + range.samples; ++k) {
      destination_.half = static_cast<int>(k % film::kHalves);
      destination_.group = static_cast<int>(k % film::kStatisticsGroups);
      for (int i = 0; i < kGroupSize; i += kLanes) run_pack(first_cell + i, k);
    }
  }

  SegmentOutput finish() {
    SegmentOutput out;
    out.digest = splatter_.digest();
    out.anomalies = anomalies_;
    out.counts.mutations = tracer_.costs().paths;
    out.counts.path_evaluations = tracer_.costs().paths;
    out.counts.rays = tracer_.costs().rays;
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
    const transport::Contribution c =
        tracer_.trace(source_, context_.cell_windows(first_cell), first_lanes(left));
    for (const diagnostics::Incident& incident : tracer_.incidents()) log(incident);
    splat(c, number, left);
  }

  void log(const diagnostics::Incident& incident) {
    anomalies_.count(incident.kind);
    if (anomalies_.wants_sample())
      anomalies_.keep({incident, replayable(source_.read_pairs(incident.lane))});
  }

  void splat(const transport::Contribution& c, uint64_t number, int lanes) {
    const Spectrum value = c.radiance * Float(scale_);
    alignas(32) float x[kLanes], y[kLanes], r[kLanes], g[kLanes], b[kLanes];
    c.raster_x.store_aligned(x);
    c.raster_y.store_aligned(y);
    value.x.store_aligned(r);
    value.y.store_aligned(g);
    value.z.store_aligned(b);
    for (int lane = 0; lane < lanes; ++lane) {
      const float rgb[3] = {r[lane], g[lane], b[lane]};
      const float largest = std::max({rgb[0], rgb[1], rgb[2]});
      if (largest == 0) continue;
      if (!(largest < kLargestSample)) {
        log({diagnostics::AnomalyKind::kOutOfRange, diagnostics::Place::kFilm, 0,
             static_cast<uint8_t>(lane)});
        continue;
      }
      splatter_.splat(destination_, x[lane], y[lane], rgb, mix64(noise_ + number + lane));
    }
  }

  const Context& context_;
  transport::PathTracer tracer_;
  primary_space::StratifiedSource source_;
  film::Splatter splatter_;
  film::Destination destination_;
  diagnostics::AnomalyLog anomalies_;
  float scale_;
  uint64_t noise_;
};

}  // namespace

SegmentOutput run_path_segment(const Context& context, const PathRange& range, film::Film& film) {
  PathRun run(context, film);
  const uint64_t first = uint64_t(range.segment) * context.spec().blocks_per_segment;
  const uint64_t last = std::min(first + context.spec().blocks_per_segment, context.blocks());
  for (uint64_t block = first; block < last; ++block) run.run_block(block * kGroupSize, range);
  return run.finish();
}

}  // namespace metrofarm::work_unit
