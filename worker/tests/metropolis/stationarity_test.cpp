// Chains that start from the exact target distribution stay in it: after any number of steps every
// estimator must match the exact answer, whatever constant c the two-layer weights use.
#include <gtest/gtest.h>

#include <tuple>

#include "metropolis/chain_pack.h"
#include "tests/metropolis/branching_target.h"
#include "tests/support/statistics.h"

namespace metrofarm::metropolis {
namespace {

using metrofarm::test::Moments;
using test::BranchingTarget;

constexpr int kPacks = 16000;
constexpr int kIterations = 10;
constexpr double kFalseAlarm = 1e-5;

struct Outcome {
  std::vector<Moments> bins = std::vector<Moments>(BranchingTarget::kBins);
  Moments total;
  ChainCounts counts;
};

void load(ChainPack& chains, BranchingTarget& target, const test::ExactStart* starts) {
  ChainPack::State state;
  for (int lane = 0; lane < kLanes; ++lane) {
    state.f[lane] = starts[lane].payload.f;
    target.set_current(lane, starts[lane].payload);
    chains.sample().restore(lane, starts[lane].pairs);
  }
  chains.set_state(state);
}

// Both layers developed and added, one independent estimate per pack.
Outcome run(const Kernel& kernel, double c, bool eager, uint64_t seed) {
  const double b = BranchingTarget::integral();
  const double iterations = double{kIterations} * kLanes;
  const double develop[2] = {b / iterations, c / (kernel.large_step_probability * iterations)};
  const auto starts = test::exact_starts(eager, size_t{kPacks} * kLanes, seed);
  BranchingTarget target(eager);
  Outcome out;
  std::vector<double> sums(BranchingTarget::kBins);
  target.set_sink([&](const BranchingTarget::Record& r) {
    const double v = develop[static_cast<int>(r.layer)] * r.scale * r.f;
    sums[r.bin] += v;
    if (r.core_bin >= 0) sums[r.core_bin] += v;
  });
  for (uint32_t pack = 0; pack < kPacks; ++pack) {
    std::fill(sums.begin(), sums.end(), 0.0);
    ChainPack chains({rng_key(seed, RngDomain::kChain), pack * kLanes, kernel, c}, target);
    load(chains, target, &starts[size_t{pack} * kLanes]);
    chains.advance(kIterations);
    chains.flush();
    double total = 0;
    for (int i = 0; i < BranchingTarget::kBins; ++i) {
      out.bins[i].add(sums[i]);
      if (i < BranchingTarget::kBins - 2) total += sums[i];
    }
    out.total.add(total);
    out.counts += chains.counts();
  }
  return out;
}

Kernel kernel_of(KernelKind kind) {
  Kernel kernel;
  kernel.kind = kind;
  kernel.sigma = 0.015;
  return kernel;
}

class StationarityTest : public testing::TestWithParam<std::tuple<KernelKind, double, bool>> {};

// H0: the developed sum of every bin has the bin's integral as its mean. z-tests of 152 bins and of
// the total over 16,000 independent packs of 80 iterations, family rate 1e-5.
TEST_P(StationarityTest, EveryBinMatchesTheExactAnswer) {
  const auto [kind, factor, eager] = GetParam();
  const double c = factor * BranchingTarget::integral();
  const Outcome out = run(kernel_of(kind), c, eager, 100 + static_cast<uint64_t>(factor * 10));
  const std::vector<double> exact = BranchingTarget::bin_integrals();
  const double rate = metrofarm::test::sidak(kFalseAlarm, BranchingTarget::kBins + 1);
  for (int i = 0; i < BranchingTarget::kBins; ++i)
    EXPECT_TRUE(metrofarm::test::has_mean(out.bins[i], exact[i], rate, 1e-9)) << "bin " << i;
  EXPECT_TRUE(metrofarm::test::has_mean(out.total, BranchingTarget::integral(), rate));
}

INSTANTIATE_TEST_SUITE_P(
    LazyAndEager, StationarityTest,
    testing::Combine(testing::Values(KernelKind::kKelemenPair, KernelKind::kGaussian),
                     testing::Values(0.1, 1.0, 3.0), testing::Values(false, true)));

// H0: lazy and eager chains accept equally often in their stationary state. About 0.9 million small
// and 0.4 million large steps each; the counts of a pack's neighbours are nearly independent, the
// binomial error is doubled for what correlation there is. Rate 1e-5 each.
TEST(Lazy, AcceptsAsOftenAsEager) {
  const double c = BranchingTarget::integral();
  const Kernel kernel;
  const ChainCounts lazy = run(kernel, c, false, 21).counts;
  const ChainCounts eager = run(kernel, c, true, 22).counts;
  const auto z = [](uint64_t a, uint64_t n, uint64_t b, uint64_t m) {
    const double pa = double(a) / double(n), pb = double(b) / double(m);
    const double p = double(a + b) / double(n + m);
    return (pa - pb) / std::sqrt(p * (1 - p) * (1 / double(n) + 1 / double(m)));
  };
  EXPECT_GT(metrofarm::test::normal_p(0.5 * z(lazy.small_accepted, lazy.small_steps,
                                              eager.small_accepted, eager.small_steps)),
            1e-5);
  EXPECT_GT(metrofarm::test::normal_p(0.5 * z(lazy.large_accepted, lazy.large_steps,
                                              eager.large_accepted, eager.large_steps)),
            1e-5);
}

// The bins' integrals, which everything above relies on, against plain Monte Carlo: H0: their means
// agree. 800,000 samples, family rate 1e-5.
TEST(BranchingTarget, IntegralsAgreeWithMonteCarlo) {
  BranchingTarget target(false);
  primary_space::IndependentSource source(rng_key(5, RngDomain::kTest));
  std::vector<double> now(BranchingTarget::kBins);
  std::vector<Moments> bins(BranchingTarget::kBins);
  target.set_sink([&](const BranchingTarget::Record& r) {
    now[r.bin] += r.f / kLanes;
    if (r.core_bin >= 0) now[r.core_bin] += r.f / kLanes;
  });
  for (uint64_t i = 0; i < 800000; i += kLanes) {
    source.begin(i);
    target.evaluate(source);
    std::fill(now.begin(), now.end(), 0.0);
    target.record(Which::kProposal, Layer::kLargeStep, Float(1.F), all_lanes(), 0);
    for (int k = 0; k < BranchingTarget::kBins; ++k) bins[k].add(now[k]);
  }
  const std::vector<double> exact = BranchingTarget::bin_integrals();
  double sum = 0;
  for (int k = 0; k < BranchingTarget::kBins; ++k) {
    EXPECT_TRUE(metrofarm::test::has_mean(
        bins[k], exact[k], metrofarm::test::sidak(1e-5, BranchingTarget::kBins), 1e-9))
        << "bin " << k;
    if (k < BranchingTarget::kBins - 2) sum += exact[k];
  }
  EXPECT_NEAR(sum, BranchingTarget::integral(), 1e-6);
}

}  // namespace
}  // namespace metrofarm::metropolis
