// Direct light apart, and trials of kernels.
#include <gtest/gtest.h>

#include "film/film.h"
#include "tests/support/film_values.h"
#include "tests/work_unit/support.h"

namespace metrofarm::work_unit {
namespace {

Spec apart(uint32_t groups) {
  Spec spec = test::Job::spec_of(Integrator::kPssmlt);
  spec.direct_apart = true;
  spec.chain_groups = groups;
  return spec;
}

// The groups of a round share the cells: every pixel of a constant sky gets each sample once, in a
// layer of its own.
TEST(DirectLight, GroupsCoverTheFilmOnce) {
  metrofarm::test::SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{4096, 4096, 4096}});
  const test::Job job(Integrator::kPssmlt, b.take());
  for (uint32_t groups : {1U, 7U, 16U, 100U}) {
    const Context context(job.scene, apart(groups));
    ASSERT_EQ(problem_with(context.spec()), "");
    ASSERT_EQ(context.film_shape().layers, 3);
    film::Film film(context.film_shape());
    uint64_t digest = 0, paths = 0;
    for (uint32_t g = 0; g < groups; ++g) {
      const SegmentOutput out = run_direct_segment(context, g, {6, 4}, film);
      digest += out.digest;
      paths += out.counts.path_evaluations;
      EXPECT_EQ(out.counts.mutations, 0U);
    }
    EXPECT_EQ(digest, metrofarm::test::digest_from_planes(film));
    EXPECT_EQ(paths, 4 * context.cells());
    // 2 samples to each half, of radiance 4096 in units of 4096 times 0.5.
    const std::vector<int64_t> values = metrofarm::test::all_values(film);
    const size_t plane = context.film_shape().pixels() * film::kChannels;
    for (int half = 0; half < film::kHalves; ++half) {
      for (size_t i = 0; i < plane; ++i) {
        const size_t at = (size_t(half) * 3 + kDirectLayer) * plane + i;
        ASSERT_EQ(values[at], int64_t{4} << 32) << "half " << half << " value " << i;
      }
    }
  }
}

TEST(DirectLight, TakesNoMoreThanOneBounce) {
  const test::Job job(Integrator::kPssmlt);
  const Context context(job.scene, apart(1));
  film::Film film(context.film_shape());
  const SegmentOutput out = run_direct_segment(context, 0, {0, 2}, film);
  // A camera ray, a shadow ray and one more for each path at most.
  EXPECT_LE(out.counts.rays, 3 * out.counts.path_evaluations);
  EXPECT_GT(out.counts.rays, out.counts.path_evaluations);
}

TEST(DirectLight, NeedsPathsForTheChains) {
  Spec spec = apart(16);
  spec.path.max_depth = 2;
  EXPECT_NE(problem_with(spec).find("direct_sizes"), std::string::npos);
  spec.path.max_depth = 3;
  EXPECT_EQ(problem_with(spec), "");
}

TEST(KernelTrials, ReportWhatChainsDo) {
  const test::Job job(Integrator::kPssmlt);
  const ChainSeeds seeds = test::seeds_from(job.context, 0);
  double previous = 1;
  for (double factor : {0.1, 1.0, 10.0}) {
    const metropolis::Kernel kernel = metropolis::scaled(job.context.spec().kernel, factor);
    const auto trial = try_kernel(job.context, kernel, seeds, 100);
    ASSERT_TRUE(trial.ok());
    Spec spec = job.context.spec();
    spec.kernel = kernel;
    const Context context(job.scene, spec);
    film::Film film(context.film_shape());
    ChainGroup chains{0, start_chains(context, seeds).value()};
    const SegmentOutput rendered = run_chain_segment(context, chains, 100, film);
    EXPECT_EQ(trial.value().counts.small_accepted, rendered.counts.small_accepted);
    EXPECT_EQ(trial.value().counts.rays, rendered.counts.rays);
    const double share =
        double(rendered.counts.small_accepted) / double(rendered.counts.small_steps);
    EXPECT_LT(share, previous);
    previous = share;
  }
}

TEST(KernelTrials, RefuseAKernelThatIsNone) {
  const test::Job job(Integrator::kPssmlt);
  metropolis::Kernel kernel;
  kernel.s2 = 0.7;
  EXPECT_FALSE(try_kernel(job.context, kernel, test::seeds_from(job.context, 0), 10).ok());
}

}  // namespace
}  // namespace metrofarm::work_unit
