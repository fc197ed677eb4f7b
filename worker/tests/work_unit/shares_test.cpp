// First-stage proposals by path length and by technique.
#include <gtest/gtest.h>

#include <array>
#include <numeric>
#include <span>
#include <vector>

#include "film/film.h"
#include "tests/support/statistics.h"
#include "tests/work_unit/support.h"

namespace metrofarm::work_unit {
namespace {

uint64_t sum(const std::array<uint64_t, Shares::kLargest + 1>& counts) {
  return std::accumulate(counts.begin(), counts.end(), uint64_t{0});
}

Counts run(const test::Job& job, const Spec& spec, uint64_t mutations) {
  const Context context(job.scene, spec);
  EXPECT_EQ(problem_with(spec), "");
  film::Film film(context.film_shape());
  ChainGroup chains{0, start_chains(context, test::seeds_from(context, 0)).value()};
  return run_chain_segment(context, chains, mutations, film).counts;
}

void expect_all_counted(const Counts& counts, const Shares& shares) {
  EXPECT_EQ(sum(shares.proposed), counts.mutations);
  EXPECT_EQ(sum(shares.accepted), counts.large_accepted + counts.small_accepted);
  for (size_t i = 0; i < shares.proposed.size(); ++i)
    EXPECT_LE(shares.accepted[i], shares.proposed[i]) << i;
}

TEST(Shares, ChainsOverPathsCountTheEdgesOfTheEyePath) {
  for (Under under : {Under::kPath, Under::kBdpt}) {
    const test::Job job(Integrator::kPssmlt);
    Spec spec = test::Job::spec_of(Integrator::kPssmlt);
    spec.under = under;
    const Counts counts = run(job, spec, 200);
    expect_all_counted(counts, counts.lengths);
    EXPECT_EQ(counts.lengths.proposed[0], 0U);
    EXPECT_GT(counts.lengths.proposed[8], 0U);
    for (size_t i = 9; i <= Shares::kLargest; ++i) EXPECT_EQ(counts.lengths.proposed[i], 0U) << i;
    EXPECT_EQ(sum(counts.techniques.proposed), 0U);
  }
}

// All proposals reject the second stage's reverse path: it is none of the first stage's.
TEST(Shares, OnlyFirstStagesCount) {
  const test::Job job(Integrator::kPssmlt);
  Spec spec = test::Job::spec_of(Integrator::kPssmlt);
  spec.delayed_rejection.move = metropolis::SecondMove::kLocal;
  spec.delayed_rejection.rule = metropolis::AcceptanceRule::kGreenMira;
  const Counts counts = run(job, spec, 200);
  EXPECT_GT(counts.second_stages, 0U);
  expect_all_counted(counts, counts.lengths);
}

testing::AssertionResult fits(const Shares& shares, std::span<const double> expected) {
  std::vector<double> observed(shares.proposed.begin(), shares.proposed.end());
  for (double& count : observed) count /= kLanes;
  for (size_t i = expected.size(); i < observed.size(); ++i)
    if (observed[i] > 0) return testing::AssertionFailure() << "something at " << i;
  const auto test =
      metrofarm::test::chi_square(std::span(observed).first(expected.size()), expected);
  if (test.p > 1e-6) return testing::AssertionSuccess();
  return testing::AssertionFailure() << "p = " << test.p;
}

// Large steps draw lengths with the probabilities of the spec and techniques evenly: chi-square
// tests, whose false-alarm rate is 1e-6 each, of 8 * 1600 independent draws: one for each pack.
TEST(Shares, MultiplexedChainsCountLengthAndTechnique) {
  const test::Job job(Integrator::kMmlt);
  Spec spec = test::Job::spec_of(Integrator::kMmlt);
  spec.length_probabilities = {0.05, 0.25, 0.2, 0.1, 0.15, 0.1, 0.1, 0.05};
  spec.kernel.large_step_probability = 1;
  const Counts counts = run(job, spec, 1600);
  expect_all_counted(counts, counts.lengths);
  expect_all_counted(counts, counts.techniques);
  const double n = static_cast<double>(counts.mutations) / kLanes;
  std::array<double, 9> lengths{}, techniques{};
  for (size_t i = 0; i < spec.length_probabilities.size(); ++i) {
    const auto edges = static_cast<int>(i) + 1;
    lengths[edges] = n * spec.length_probabilities[i];
    const int of_length = transport::technique_count(edges);
    for (int s = 0; s < of_length; ++s) techniques[s] += lengths[edges] / of_length;
  }
  EXPECT_TRUE(fits(counts.lengths, lengths));
  EXPECT_TRUE(fits(counts.techniques, techniques));
}

TEST(Shares, GreatNumbersCountAsTheLargest) {
  Shares shares;
  const int32_t numbers[kLanes] = {0, 1, 31, 32, 33, 100, 1, 0};
  shares.add(Int::load_unaligned(numbers), 0b01100010);
  EXPECT_EQ(shares.proposed[0], 2U);
  EXPECT_EQ(shares.proposed[1], 2U);
  EXPECT_EQ(shares.proposed[32], 3U);
  EXPECT_EQ(shares.accepted[0], 0U);
  EXPECT_EQ(shares.accepted[1], 2U);
  EXPECT_EQ(shares.accepted[32], 1U);
}

}  // namespace
}  // namespace metrofarm::work_unit
