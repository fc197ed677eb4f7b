#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <stop_token>

#include "tests/support/film_values.h"
#include "tests/support/statistics.h"
#include "tests/work_unit/support.h"

namespace metrofarm::work_unit {
namespace {

using metrofarm::test::all_values;
using metrofarm::test::digest_from_planes;

struct Rendered {
  std::vector<int64_t> values;
  std::vector<uint64_t> digests;
  std::vector<std::string> states;
};

std::vector<size_t> shuffled(size_t count, uint64_t seed) {
  std::vector<size_t> order(count);
  std::iota(order.begin(), order.end(), size_t{0});
  if (seed != 0) std::shuffle(order.begin(), order.end(), std::mt19937_64(seed));
  return order;
}

Rendered run_chains(const Context& context, const std::vector<GroupState>& starts, int threads,
                    uint64_t order_seed) {
  film::Film film(context.film_shape());
  Rendered run;
  run.digests.resize(starts.size());
  run.states.resize(starts.size());
  const std::vector<size_t> order = shuffled(starts.size(), order_seed);
  parallel_for(starts.size(), threads, [&](size_t i, int) {
    const size_t group = order[i];
    ChainGroup chains{static_cast<uint32_t>(group), starts[group]};
    run.digests[group] = run_chain_segment(context, chains, 60, film).digest;
    run.states[group] = serialize(chains.state);
  });
  run.values = all_values(film);
  uint64_t sum = 0;
  for (uint64_t d : run.digests) sum += d;
  EXPECT_EQ(sum, digest_from_planes(film));
  return run;
}

TEST(ChainSegments, NeitherThreadsNorOrderChangeABit) {
  const test::Job job(Integrator::kPssmlt);
  std::vector<GroupState> starts;
  for (int group = 0; group < 9; ++group)
    starts.push_back(
        start_chains(job.context, test::seeds_from(job.context, 1024 * group)).value());
  const Rendered reference = run_chains(job.context, starts, 1, 0);
  for (int threads : {1, 2, 7}) {
    const Rendered other = run_chains(job.context, starts, threads, threads);
    EXPECT_EQ(other.values, reference.values);
    EXPECT_EQ(other.digests, reference.digests);
    EXPECT_EQ(other.states, reference.states);
  }
}

TEST(ChainSegments, CuttingASegmentChangesNoTrajectory) {
  const test::Job job(Integrator::kPssmlt);
  const GroupState start = start_chains(job.context, test::seeds_from(job.context, 0)).value();
  film::Film film(job.context.film_shape()), cut_film(job.context.film_shape());
  ChainGroup whole{3, start};
  run_chain_segment(job.context, whole, 100, film);
  ChainGroup cut{3, start};
  run_chain_segment(job.context, cut, 37, cut_film);
  // Through the wire, as between two workers.
  cut.state = parse_group_state(serialize(cut.state)).value();
  run_chain_segment(job.context, cut, 63, cut_film);
  for (int p = 0; p < kPacksPerGroup; ++p) {
    // The serial numbers of records differ: a cut adds one flush.
    cut.state[p].chains.serial = whole.state[p].chains.serial;
  }
  EXPECT_EQ(serialize(cut.state), serialize(whole.state));
}

TEST(ChainSegments, CountsAreThoseOfTheWork) {
  const test::Job job(Integrator::kPssmlt);
  ChainGroup chains{0, start_chains(job.context, test::seeds_from(job.context, 0)).value()};
  film::Film film(job.context.film_shape());
  const SegmentOutput out = run_chain_segment(job.context, chains, 50, film);
  EXPECT_EQ(out.counts.mutations, 50U * kGroupSize);
  EXPECT_EQ(out.counts.path_evaluations, 50U * kGroupSize);
  EXPECT_EQ(out.counts.large_steps + out.counts.small_steps, out.counts.mutations);
  EXPECT_GT(out.counts.rays, out.counts.path_evaluations);
  for (uint64_t n : out.anomalies.counts()) EXPECT_EQ(n, 0U);
}

TEST(ChainSegments, GroupsGoToTheirHalfAndStatistics) {
  const test::Job job(Integrator::kPssmlt);
  const GroupState start = start_chains(job.context, test::seeds_from(job.context, 0)).value();
  for (uint32_t group : {0U, 5U, 17U}) {
    film::Film film(job.context.film_shape());
    ChainGroup chains{group, start};
    run_chain_segment(job.context, chains, 10, film);
    for (int plane = 0; plane < 4; ++plane) {
      const bool mine = plane / 2 == static_cast<int>(group % 2);
      EXPECT_EQ(metrofarm::test::sum_of(film, plane, 1) > 0, mine) << "plane " << plane;
    }
    std::vector<int64_t> cells(768);
    for (int plane = 0; plane < 32; ++plane)
      EXPECT_EQ(film.read_low(plane, cells.data()), plane / 2 == static_cast<int>(group % 16));
  }
}

Rendered run_paths(const Context& context, int threads, uint64_t order_seed, int parts) {
  film::Film film(context.film_shape());
  Rendered run;
  run.digests.resize(context.blocks());
  const std::vector<size_t> order = shuffled(context.blocks(), order_seed);
  parallel_for(order.size(), threads, [&](size_t i, int) {
    for (int part = 0; part < parts; ++part) {
      const SampleRange samples{uint64_t(6 / parts) * part, uint64_t(6 / parts)};
      run.digests[order[i]] +=
          run_path_segment(context, static_cast<uint32_t>(order[i]), samples, film).digest;
    }
  });
  run.values = all_values(film);
  uint64_t sum = 0;
  for (uint64_t d : run.digests) sum += d;
  EXPECT_EQ(sum, digest_from_planes(film));
  return run;
}

TEST(PathSegments, NeitherThreadsNorOrderNorRoundsChangeABit) {
  const test::Job job(Integrator::kPath);
  const Rendered reference = run_paths(job.context, 1, 0, 1);
  for (int threads : {1, 2, 7}) {
    const Rendered other = run_paths(job.context, threads, threads, threads == 2 ? 3 : 1);
    EXPECT_EQ(other.values, reference.values);
    EXPECT_EQ(other.digests, reference.digests);
  }
}

TEST(PathSegments, BlocksPerSegmentOnlyGroupTheWork) {
  test::Job job(Integrator::kPath);
  const Rendered reference = run_paths(job.context, 1, 0, 1);
  Spec spec = job.context.spec();
  spec.blocks_per_segment = 5;
  const Context context(job.scene, spec);
  film::Film film(context.film_shape());
  for (uint32_t s = 0; s < (context.blocks() + 4) / 5; ++s)
    run_path_segment(context, s, {0, 6}, film);
  EXPECT_EQ(all_values(film), reference.values);
}

TEST(PathSegments, EveryCellGetsItsSamples) {
  const test::Job job(Integrator::kPath);
  film::Film film(job.context.film_shape());
  uint64_t paths = 0;
  for (uint32_t s = 0; s < job.context.blocks(); ++s)
    paths += run_path_segment(job.context, s, {0, 3}, film).counts.path_evaluations;
  EXPECT_EQ(paths, 3 * job.context.cells());
}

// A constant environment fills every pixel with exactly samples x radiance, whatever the filter.
TEST(PathSegments, AnEvenImageIsEvenToTheEdges) {
  metrofarm::test::SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{1, 2, 3}});
  b.description().film.filter = scene::ReconstructionFilter::kTent;
  b.description().film.filter_radius = 1;
  const test::Job job(Integrator::kPath, b.take());
  film::Film film(job.context.film_shape());
  for (uint32_t s = 0; s < job.context.blocks(); ++s)
    run_path_segment(job.context, s, {0, 1000}, film);
  const auto plane = metrofarm::test::full_plane(film, 0);
  for (size_t i = 0; i < plane.size(); ++i) {
    const double expected = 500 * double(i % 3 + 1) / job.context.spec().unit;
    EXPECT_NEAR(double(plane[i]) / film::kFixedOne / expected, 1, 0.2);
  }
}

// A segment that is not wanted any more ends soon, wherever it is.
TEST(Interruption, EndsEverySegment) {
  std::stop_source stop;
  stop.request_stop();
  test::Job job(Integrator::kPath);
  film::Film film(job.context.film_shape());
  const SegmentOutput deep = run_path_segment(job.context, 0, {0, 1000}, film, stop.get_token());
  EXPECT_LE(deep.counts.path_evaluations, uint64_t{kGroupSize});
  Spec spec = job.context.spec();
  spec.blocks_per_segment = 5;
  const SegmentOutput wide =
      run_path_segment(Context(job.scene, spec), 0, {0, 1}, film, stop.get_token());
  EXPECT_LE(wide.counts.path_evaluations, uint64_t{kGroupSize});

  spec.integrator = Integrator::kPssmlt;
  spec.direct_apart = true;
  spec.chain_groups = 1;
  const Context context(job.scene, spec);
  film::Film layers(context.film_shape());
  const SegmentOutput direct = run_direct_segment(context, 0, {0, 1000}, layers, stop.get_token());
  EXPECT_LE(direct.counts.path_evaluations, uint64_t{kGroupSize});
  ChainGroup chains{0, start_chains(context, test::seeds_from(context, 0)).value()};
  const SegmentOutput steps = run_chain_segment(context, chains, 1000, layers, stop.get_token());
  EXPECT_LE(steps.counts.mutations, kDealInterval * kGroupSize);
}

scene::SceneDescription with_infinite_light() {
  scene::SceneDescription d = metrofarm::test::room();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  d.emitters.push_back({scene::AreaEmitter{{kInfinity, kInfinity, kInfinity}}, {}});
  d.shapes.push_back({scene::Sphere{{0, 0, 2}, 0.3},
                      0,
                      static_cast<scene::Index>(d.emitters.size() - 1),
                      false,
                      "",
                      {}});
  return d;
}

// Anomalies come with a primary sample: evaluated again, it is an anomaly again.
TEST(Quarantine, AnomaliesCanBeReplayed) {
  const test::Job job(Integrator::kPssmlt, with_infinite_light());
  const BootstrapOutput out = run_bootstrap(job.context, 0, 4096);
  for (float f : out.values) EXPECT_TRUE(f >= 0 && f <= std::numeric_limits<float>::max());
  uint64_t count = 0;
  for (uint64_t n : out.anomalies.counts()) count += n;
  ASSERT_GT(count, 0U);
  ASSERT_FALSE(out.anomalies.samples().empty());
  for (const diagnostics::Anomaly& anomaly : out.anomalies.samples()) {
    RenderTarget target(job.context);
    struct Replay final : primary_space::SampleSource {
      explicit Replay(const std::vector<uint32_t>& w) : words(w) {}
      primary_space::Pair pair(primary_space::Slot slot, Mask) override {
        const auto word = [&](size_t i) {
          return unit_float(UInt(i < words.size() ? words[i] : 0U));
        };
        return {word(2 * size_t(slot)), word(2 * size_t(slot) + 1)};
      }
      std::vector<primary_space::StoredPair> read_pairs(int) const override { return {}; }
      const std::vector<uint32_t>& words;
    } replay(anomaly.primary_sample);
    target.evaluate(replay, metropolis::Which::kProposal, all_lanes());
    EXPECT_GT(target.anomalies().counts()[static_cast<size_t>(anomaly.incident.kind)], 0U);
  }
}

TEST(Quarantine, ASampleBeyondTheFilmIsCounted) {
  metrofarm::test::SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{1e7F, 1e7F, 1e7F}});
  const test::Job job(Integrator::kPath, b.take());
  film::Film film(job.context.film_shape());
  const SegmentOutput out = run_path_segment(job.context, 0, {0, 1}, film);
  EXPECT_EQ(out.anomalies.counts()[static_cast<size_t>(diagnostics::AnomalyKind::kOutOfRange)],
            64U);
  EXPECT_EQ(out.digest, 0U);
  EXPECT_EQ(digest_from_planes(film), 0U);
}

}  // namespace
}  // namespace metrofarm::work_unit
