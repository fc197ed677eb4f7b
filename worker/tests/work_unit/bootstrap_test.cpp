#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "tests/work_unit/support.h"
#include "work_unit/version.h"

namespace metrofarm::work_unit {
namespace {

TEST(Bootstrap, ValuesDontDependOnHowTheRangeIsCut) {
  const test::Job job(Integrator::kPssmlt);
  const BootstrapOutput whole = run_bootstrap(job.context, 64, 512);
  std::vector<float> parts;
  uint64_t rays = 0;
  for (auto [first, count] : {std::pair{64, 8}, {72, 320}, {392, 184}}) {
    const BootstrapOutput part = run_bootstrap(job.context, first, count);
    parts.insert(parts.end(), part.values.begin(), part.values.end());
    rays += part.rays;
  }
  EXPECT_EQ(parts, whole.values);
  EXPECT_EQ(rays, whole.rays);
}

TEST(Bootstrap, ValuesDontDependOnThreads) {
  const test::Job job(Integrator::kPssmlt);
  const BootstrapOutput whole = run_bootstrap(job.context, 0, 512);
  for (int threads : {2, 7}) {
    std::vector<float> values(512);
    parallel_for(8, threads, [&](size_t i, int) {
      const BootstrapOutput part = run_bootstrap(job.context, 64 * i, 64);
      std::copy(part.values.begin(), part.values.end(), values.begin() + 64 * i);
    });
    EXPECT_EQ(values, whole.values);
  }
}

TEST(Bootstrap, SeedsDiffer) {
  const test::Job job(Integrator::kPssmlt);
  Spec other = job.context.spec();
  other.seed = 78;
  EXPECT_NE(run_bootstrap(job.context, 0, 64).values,
            run_bootstrap(Context(job.scene, other), 0, 64).values);
}

TEST(StartChains, ReproducesItsSeeds) {
  const test::Job job(Integrator::kPssmlt);
  const ChainSeeds seeds = test::seeds_from(job.context, 1024);
  const auto state = start_chains(job.context, seeds);
  ASSERT_TRUE(state.ok());
  for (int chain = 0; chain < kGroupSize; ++chain) {
    const PackState& pack = state.value()[chain / kLanes];
    EXPECT_EQ(pack.chains.f[chain % kLanes], seeds.values[chain]);
    EXPECT_NEAR(luminance(pack.payload[chain % kLanes].splats[0].rgb), seeds.values[chain],
                1e-6 * seeds.values[chain]);
    EXPECT_FALSE(pack.pairs[chain % kLanes].empty());
  }
}

TEST(StartChains, RefusesAValueThatIsOneUlpOff) {
  const test::Job job(Integrator::kPssmlt);
  const ChainSeeds seeds = test::seeds_from(job.context, 0);
  for (int chain : {0, 13, 63}) {
    for (float towards : {0.F, 1e30F}) {
      ChainSeeds wrong = seeds;
      wrong.values[chain] = std::nextafter(wrong.values[chain], towards);
      const auto state = start_chains(job.context, wrong);
      ASSERT_FALSE(state.ok());
      EXPECT_NE(state.error().message.find(std::to_string(wrong.indices[chain])),
                std::string::npos);
    }
  }
}

TEST(StartChains, RefusesSeedsThatAreNoSeeds) {
  const test::Job job(Integrator::kPssmlt);
  ChainSeeds seeds = test::seeds_from(job.context, 0);
  ChainSeeds few = seeds;
  few.indices.pop_back();
  EXPECT_FALSE(start_chains(job.context, few).ok());
  ChainSeeds nan = seeds;
  nan.values[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(start_chains(job.context, nan).ok());
}

TEST(Version, TheProbeIsStable) {
  const std::string once = probe_hash("avx2");
  EXPECT_EQ(once.size(), 16U);
  EXPECT_EQ(probe_hash("avx2"), once);
}

TEST(Version, TheProbeDoesNotDependOnTheThread) {
  std::vector<std::string> hashes(3);
  parallel_for(3, 3, [&](size_t i, int) { hashes[i] = probe_hash("avx2"); });
  EXPECT_EQ(hashes[0], hashes[1]);
  EXPECT_EQ(hashes[0], hashes[2]);
}

}  // namespace
}  // namespace metrofarm::work_unit
