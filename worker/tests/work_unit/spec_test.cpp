#include <gtest/gtest.h>

#include <limits>

#include "tests/work_unit/support.h"

namespace metrofarm::work_unit {
namespace {

Spec good() {
  return test::Job::spec_of(Integrator::kPssmlt);
}

// The message for a spec with one thing changed.
template <class Change>
std::string problem(Change&& change) {
  Spec spec = good();
  change(spec);
  return problem_with(spec);
}

TEST(Spec, AGoodOneHasNoProblem) {
  EXPECT_EQ(problem_with(good()), "");
  EXPECT_EQ(problem_with(test::Job::spec_of(Integrator::kPath)), "");
  EXPECT_EQ(problem([](Spec& s) { s.kernel.large_step_probability = 1; }), "");
  EXPECT_EQ(problem([](Spec& s) { s.path.max_depth = -1; }), "");
}

TEST(Spec, ProblemsNameTheField) {
  const auto names = [](const std::string& message, const char* field) {
    return message.find(field) != std::string::npos;
  };
  EXPECT_TRUE(names(problem([](Spec& s) { s.width = 0; }), "width"));
  EXPECT_TRUE(names(problem([](Spec& s) { s.height = 40000; }), "height"));
  for (double unit : {0.0, -1.0, std::numeric_limits<double>::infinity(),
                      std::numeric_limits<double>::quiet_NaN()})
    EXPECT_TRUE(names(problem([&](Spec& s) { s.unit = unit; }), "unit")) << unit;
  EXPECT_TRUE(names(problem([](Spec& s) { s.path.max_depth = -2; }), "max_depth"));
  EXPECT_TRUE(names(problem([](Spec& s) { s.path.rr_depth = 0; }), "rr_depth"));
  EXPECT_TRUE(names(problem([](Spec& s) { s.blocks_per_segment = 0; }), "blocks_per_segment"));
  for (double p : {0.0, 1.1, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_TRUE(names(problem([&](Spec& s) { s.kernel.large_step_probability = p; }),
                      "large_step_probability"));
  }
}

TEST(Spec, KernelsAreChecked) {
  for (auto [s1, s2] : {std::pair{0.0, 0.1}, {0.1, 0.1}, {0.2, 0.1}, {0.1, 0.5}})
    EXPECT_NE(problem([&](Spec& s) { s.kernel.s1 = s1, s.kernel.s2 = s2; }), "") << s1 << " " << s2;
  for (double sigma : {0.0, 0.25, -0.1}) {
    EXPECT_NE(problem([&](Spec& s) {
                s.kernel.kind = metropolis::KernelKind::kGaussian;
                s.kernel.sigma = sigma;
              }),
              "");
  }
}

Spec multiplexed() {
  Spec spec = test::Job::spec_of(Integrator::kMmlt);
  spec.path.max_depth = 5;
  spec.bootstrap_samples = uint64_t{128} * 5 * 3;
  spec.length_probabilities = {0, 0.4, 0.3, 0.2, 0.1};
  return spec;
}

TEST(Spec, MultiplexedPathsAreLimited) {
  Spec spec = multiplexed();
  for (int depth : {-1, 0, 33}) {
    spec.path.max_depth = depth;
    EXPECT_NE(problem_with(spec).find("max_depth must lie in 1..32"), std::string::npos) << depth;
  }
  spec.integrator = Integrator::kBdpt;
  spec.path.max_depth = -1;
  EXPECT_EQ(problem_with(spec), "");
}

TEST(Spec, BidirectionalTracingHasEveryTechnique) {
  for (Integrator integrator : {Integrator::kBdpt, Integrator::kMmlt, Integrator::kPssmlt}) {
    Spec spec = multiplexed();
    spec.integrator = integrator;
    spec.under = Under::kBdpt;
    EXPECT_EQ(problem_with(spec), "");
    spec.path.light_sampling = transport::LightSampling::kBsdf;
    EXPECT_NE(problem_with(spec).find("light_sampling"), std::string::npos);
  }
}

TEST(Spec, LengthProbabilitiesAreADistributionOverAllLengths) {
  EXPECT_EQ(problem_with(multiplexed()), "");
  const auto complaint = [](std::vector<double> p) {
    Spec spec = multiplexed();
    spec.length_probabilities = std::move(p);
    return problem_with(spec);
  };
  EXPECT_EQ(complaint({}), "");  // while the bootstrap runs
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const std::vector<double>& p : {std::vector<double>{1},
                                       {0.2, 0.2, 0.2, 0.2},
                                       {0, 0.4, 0.3, 0.2, 0.1001},
                                       {-0.1, 0.5, 0.3, 0.2, 0.1},
                                       {nan, 0.4, 0.3, 0.2, 0.1}})
    EXPECT_NE(complaint(p).find("length_probabilities"), std::string::npos) << p.size();
  Spec spec = multiplexed();
  spec.bootstrap_samples = 128;
  EXPECT_NE(problem_with(spec).find("16 max_depth"), std::string::npos);
}

TEST(Context, TheSampledRasterIncludesTheFiltersBorder) {
  scene::SceneDescription description = metrofarm::test::room();
  description.film.filter = scene::ReconstructionFilter::kGaussian;
  description.film.filter_radius = 2;
  const test::Job job(Integrator::kPath, std::move(description));
  EXPECT_EQ(job.context.cells(), 44U * 40U);
  EXPECT_EQ(job.context.blocks(), (44U * 40U + 63) / 64);
  const transport::RasterWindow whole = job.context.whole_raster();
  EXPECT_EQ(lane_value(whole.x, 0), -2);
  EXPECT_EQ(lane_value(whole.width, 0), 44);
  const transport::RasterWindow cells = job.context.cell_windows(44 * 3 + 40);
  EXPECT_EQ(lane_value(cells.x, 3), 41);
  EXPECT_EQ(lane_value(cells.x, 4), -2);
  EXPECT_EQ(lane_value(cells.y, 4), 2);
  EXPECT_EQ(lane_value(cells.width, 0), 1);
}

TEST(Context, LayersFollowTheIntegrator) {
  EXPECT_EQ(test::Job(Integrator::kPath).context.film_shape().layers, 1);
  EXPECT_EQ(test::Job(Integrator::kPssmlt).context.film_shape().layers, 2);
}

}  // namespace
}  // namespace metrofarm::work_unit
