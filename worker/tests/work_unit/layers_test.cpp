// Layers of the film beside the image.
#include <gtest/gtest.h>

#include <array>
#include <numeric>
#include <vector>

#include "film/film.h"
#include "tests/support/film_values.h"
#include "tests/work_unit/support.h"

namespace metrofarm::work_unit {
namespace {

using metrofarm::test::full_plane;
using metrofarm::test::low_plane;
using metropolis::Layer;

struct Rendered {
  Rendered(const test::Job& job, const Spec& spec, uint64_t mutations)
      : context(job.scene, spec), film(context.film_shape()) {
    EXPECT_EQ(problem_with(spec), "");
    ChainGroup chains{3, start_chains(context, test::seeds_from(context, 0)).value()};
    for (int segment = 0; segment < 2; ++segment) {
      // The second goes on from a state that was stored.
      chains.state = parse_group_state(serialize(chains.state)).value();
      const SegmentOutput out = run_chain_segment(context, chains, mutations / 2, film);
      digest += out.digest;
      large += out.counts.large_steps;
      accepted += out.counts.large_accepted + out.counts.small_accepted;
    }
  }
  // Of the half that group 3 belongs to.
  std::vector<int64_t> plane(int layer) const {
    return full_plane(film, film.shape().layers + layer);
  }
  std::vector<int64_t> statistics(int layer) const {
    return low_plane(film, 3 * film.shape().layers + layer);
  }

  Context context;
  film::Film film;
  uint64_t digest = 0, large = 0, accepted = 0;
};

Spec with_layers(Integrator integrator, bool acceptance, bool techniques) {
  Spec spec = test::Job::spec_of(integrator);
  spec.acceptance_layer = acceptance;
  spec.technique_layers = techniques;
  return spec;
}

TEST(Layers, ChangeNothingOfTheImage) {
  const test::Job job(Integrator::kMmlt);
  const Rendered plain(job, with_layers(Integrator::kMmlt, false, false), 60);
  const Rendered layered(job, with_layers(Integrator::kMmlt, true, true), 60);
  EXPECT_EQ(plain.film.shape().layers, 2);
  EXPECT_EQ(layered.film.shape().layers, 13);
  for (int layer = 0; layer < 2; ++layer) {
    EXPECT_EQ(plain.plane(layer), layered.plane(layer));
    EXPECT_EQ(plain.statistics(layer), layered.statistics(layer));
  }
  EXPECT_EQ(layered.digest, metrofarm::test::digest_from_planes(layered.film));
}

TEST(Layers, ImagesByTechniqueSumToTheImageExactly) {
  const test::Job job(Integrator::kMmlt);
  for (bool apart : {false, true}) {
    Spec spec = with_layers(Integrator::kMmlt, true, true);
    spec.direct_apart = apart;
    spec.chain_groups = 16;
    const Rendered r(job, spec, 60);
    for (const Layer layer : {Layer::kChain, Layer::kLargeStep}) {
      std::vector<int64_t> sum(r.plane(0).size()), statistics(r.statistics(0).size());
      for (int t = 0; t < kTechniqueImages; ++t) {
        const int at = r.context.technique_layer(t, layer);
        const std::vector<int64_t> plane = r.plane(at), low = r.statistics(at);
        EXPECT_GT(std::accumulate(plane.begin(), plane.end(), int64_t{0}), 0) << "technique " << t;
        for (size_t i = 0; i < sum.size(); ++i) sum[i] += plane[i];
        for (size_t i = 0; i < statistics.size(); ++i) statistics[i] += low[i];
      }
      EXPECT_EQ(sum, r.plane(static_cast<int>(layer)));
      EXPECT_EQ(statistics, r.statistics(static_cast<int>(layer)));
    }
    EXPECT_EQ(r.context.technique_layer(kTechniqueImages - 1, Layer::kLargeStep) + 1,
              r.film.shape().layers);
  }
}

// Without a border every path of the eye lies on the film: all proposals are counted, their mean
// acceptance probability is the share that was accepted, and large steps are large steps.
TEST(Layers, TheAcceptanceMapHasEveryProposal) {
  const test::Job job(Integrator::kPssmlt, [] {
    scene::SceneDescription d = metrofarm::test::room();
    d.film.filter = scene::ReconstructionFilter::kBox;
    d.film.filter_radius = 0.5;
    return d;
  }());
  const Rendered r(job, with_layers(Integrator::kPssmlt, true, false), 200);
  ASSERT_EQ(r.film.shape().layers, 3);
  std::array<double, film::kChannels> sums{};
  const std::vector<int64_t> values = r.plane(r.context.acceptance_layer());
  for (size_t i = 0; i < values.size(); ++i) {
    EXPECT_GE(values[i], 0);
    EXPECT_LE(values[i], values[i - i % film::kChannels]);
    sums[i % film::kChannels] += double(values[i]) / film::kFixedOne;
  }
  constexpr double kMutations = 200 * kGroupSize;
  EXPECT_EQ(sums[0], kMutations);
  EXPECT_EQ(sums[2], static_cast<double>(r.large));
  // The coins of 12800 acceptances: five standard deviations of at most 0.0045.
  EXPECT_NEAR(sums[1] / kMutations, static_cast<double>(r.accepted) / kMutations, 0.0225);
  EXPECT_EQ(r.digest, metrofarm::test::digest_from_planes(r.film));
}

TEST(Layers, TechniquesBelongToMultiplexedPaths) {
  const Spec spec = with_layers(Integrator::kPssmlt, false, true);
  EXPECT_NE(problem_with(spec).find("mmlt"), std::string::npos);
}

}  // namespace
}  // namespace metrofarm::work_unit
