#include "rpc/convert.h"

#include <gtest/gtest.h>

#include "tests/support/room.h"

namespace metrofarm::rpc {
namespace {

using job::v1::ResolvedSpec;

ResolvedSpec good_spec() {
  ResolvedSpec s;
  s.set_integrator(job::v1::INTEGRATOR_PSSMLT);
  s.set_light_sampling(job::v1::LIGHT_SAMPLING_EMITTER);
  s.set_max_depth(7);
  s.set_rr_depth(4);
  s.set_width(320);
  s.set_height(200);
  s.set_seed(99);
  s.set_bootstrap_samples(8192);
  s.set_group_size(64);
  s.mutable_kernel()->set_kind(job::v1::KERNEL_KIND_GAUSSIAN);
  s.mutable_kernel()->set_sigma(0.02);
  s.mutable_kernel()->set_large_step_probability(0.25);
  s.set_unit(0.125);
  s.set_blocks_per_segment(9);
  s.set_under(job::v1::UNDER_PATH);
  s.set_layer_weights(job::v1::LAYER_WEIGHTS_TWO_LAYER);
  return s;
}

// The error for a spec with one thing changed.
template <class Change>
std::string error_after(Change&& change) {
  ResolvedSpec s = good_spec();
  change(s);
  const auto spec = to_spec(s, test::room());
  return spec.ok() ? "" : spec.error().to_string();
}

TEST(ToSpec, TakesEveryField) {
  scene::SceneDescription scene = test::room();
  scene.integrator.hide_emitters = true;
  const auto spec = to_spec(good_spec(), scene);
  ASSERT_TRUE(spec.ok()) << spec.error().to_string();
  const work_unit::Spec& s = spec.value();
  EXPECT_EQ(s.integrator, work_unit::Integrator::kPssmlt);
  EXPECT_EQ(s.path.light_sampling, transport::LightSampling::kEmitter);
  EXPECT_EQ(s.path.max_depth, 7);
  EXPECT_EQ(s.path.rr_depth, 4);
  EXPECT_TRUE(s.path.hide_emitters);
  EXPECT_EQ(s.width, 320);
  EXPECT_EQ(s.height, 200);
  EXPECT_EQ(s.seed, 99U);
  EXPECT_EQ(s.bootstrap_samples, 8192U);
  EXPECT_EQ(s.kernel.kind, metropolis::KernelKind::kGaussian);
  EXPECT_EQ(s.kernel.sigma, 0.02);
  EXPECT_EQ(s.kernel.large_step_probability, 0.25);
  EXPECT_EQ(s.unit, 0.125);
  EXPECT_EQ(s.blocks_per_segment, 9U);
}

TEST(ToSpec, NamesWhatItCannotServe) {
  EXPECT_NE(error_after([](ResolvedSpec& s) { s.clear_integrator(); }).find("integrator"),
            std::string::npos);
  EXPECT_NE(error_after([](ResolvedSpec& s) { s.clear_light_sampling(); }).find("light_sampling"),
            std::string::npos);
  EXPECT_NE(
      error_after([](ResolvedSpec& s) { s.mutable_kernel()->clear_kind(); }).find("kernel.kind"),
      std::string::npos);
  EXPECT_NE(
      error_after([](ResolvedSpec& s) { s.set_bootstrap_samples(96); }).find("bootstrap_samples"),
      std::string::npos);
  EXPECT_NE(error_after([](ResolvedSpec& s) { s.set_group_size(32); }).find("group_size"),
            std::string::npos);
  EXPECT_NE(error_after([](ResolvedSpec& s) { s.set_width(4000000000U); }).find("width"),
            std::string::npos);
  EXPECT_NE(error_after([](ResolvedSpec& s) { s.set_max_depth(-5); }).find("max_depth"),
            std::string::npos);
  EXPECT_NE(error_after([](ResolvedSpec& s) { s.mutable_kernel()->set_sigma(3); }).find("sigma"),
            std::string::npos);
}

TEST(ToSpec, ChainsNeedTheirChoices) {
  const auto names = [](const std::string& message, const char* field) {
    return message.find(std::string("spec.") + field) != std::string::npos;
  };
  EXPECT_TRUE(names(error_after([](ResolvedSpec& s) { s.clear_under(); }), "under"));
  EXPECT_TRUE(
      names(error_after([](ResolvedSpec& s) { s.clear_layer_weights(); }), "layer_weights"));
  EXPECT_TRUE(
      names(error_after([](ResolvedSpec& s) { s.set_integrator(job::v1::INTEGRATOR_MMLT); }),
            "technique_coordinate"));
}

void delay(ResolvedSpec& s) {
  auto& d = *s.mutable_delayed_rejection();
  d.set_enabled(true);
  d.set_move(job::v1::SECOND_MOVE_ORBITAL);
  d.set_angle_law(job::v1::ANGLE_LAW_VON_MISES);
  d.set_concentration(3);
  d.set_acceptance_rule(job::v1::ACCEPTANCE_RULE_TIERNEY_MIRA);
  d.set_after_large_steps(true);
  d.set_local_scale(0.5);
}

TEST(ToSpec, TakesSecondStagesAndKernels) {
  ResolvedSpec s = good_spec();
  delay(s);
  s.mutable_kernel()->set_kind(job::v1::KERNEL_KIND_UNIFORM);
  s.mutable_kernel()->set_half_width(0.1);
  s.set_layer_weights(job::v1::LAYER_WEIGHTS_KELEMEN);
  const auto spec = to_spec(s, test::room());
  ASSERT_TRUE(spec.ok()) << spec.error().to_string();
  const metropolis::DelayedRejection& d = spec.value().delayed_rejection;
  EXPECT_EQ(d.move, metropolis::SecondMove::kOrbital);
  EXPECT_EQ(d.angle_law, metropolis::AngleLaw::kVonMises);
  EXPECT_EQ(d.concentration, 3);
  EXPECT_EQ(d.rule, metropolis::AcceptanceRule::kTierneyMira);
  EXPECT_TRUE(d.after_large_steps);
  EXPECT_EQ(d.local_scale, 0.5);
  EXPECT_EQ(spec.value().kernel.kind, metropolis::KernelKind::kUniform);
  EXPECT_EQ(spec.value().kernel.half_width, 0.1);
  EXPECT_EQ(spec.value().layer_weights, metropolis::LayerWeights::kKelemen);
}

TEST(ToSpec, SecondStagesThatWouldBiasAreRefused) {
  const auto error = [](auto&& change) {
    return error_after([&](ResolvedSpec& s) {
      delay(s);
      change(s, *s.mutable_delayed_rejection());
    });
  };
  EXPECT_NE(error([](auto&, auto& d) { d.clear_move(); }).find("delayed_rejection.move"),
            std::string::npos);
  EXPECT_NE(error([](auto&, auto& d) { d.clear_angle_law(); }).find("angle_law"),
            std::string::npos);
  EXPECT_NE(error([](auto&, auto& d) { d.clear_acceptance_rule(); }).find("acceptance_rule"),
            std::string::npos);
  EXPECT_NE(error([](auto&, auto& d) {
              d.set_acceptance_rule(job::v1::ACCEPTANCE_RULE_GREEN_MIRA);
            }).find("green_mira"),
            std::string::npos);
  EXPECT_NE(error([](auto& s, auto& d) {
              d.set_acceptance_rule(job::v1::ACCEPTANCE_RULE_ORBITAL);
              s.mutable_kernel()->set_kind(job::v1::KERNEL_KIND_WRAPPED_CAUCHY);
              s.mutable_kernel()->set_scale(0.01);
            }).find("isotropic"),
            std::string::npos);
}

TEST(ToSpec, BidirectionalTracingIsTaken) {
  const auto bidirectional = [](ResolvedSpec& s) {
    s.set_max_depth(8);
    s.set_light_sampling(job::v1::LIGHT_SAMPLING_MIS);
  };
  EXPECT_EQ(error_after([&](ResolvedSpec& s) {
              bidirectional(s);
              s.set_integrator(job::v1::INTEGRATOR_BDPT);
            }),
            "");
  EXPECT_EQ(error_after([&](ResolvedSpec& s) {
              bidirectional(s);
              s.set_under(job::v1::UNDER_BDPT);
            }),
            "");
  EXPECT_EQ(error_after([&](ResolvedSpec& s) {
              bidirectional(s);
              s.set_integrator(job::v1::INTEGRATOR_MMLT);
              s.set_technique_coordinate(job::v1::TECHNIQUE_COORDINATE_MUTATED);
              for (double p : {0.5, 0.25, 0.125, 0.125, 0.0, 0.0, 0.0, 0.0})
                s.add_length_probabilities(p);
            }),
            "");
}

TEST(ToSpec, LayersAreTakenWhereTheyHaveAMeaning) {
  ResolvedSpec spec = good_spec();
  spec.add_layers(job::v1::DIAGNOSTIC_LAYER_ACCEPTANCE);
  const auto taken = to_spec(spec, test::room());
  ASSERT_TRUE(taken.ok()) << taken.error().to_string();
  EXPECT_TRUE(taken.value().acceptance_layer);
  EXPECT_FALSE(taken.value().technique_layers);
  spec.add_layers(job::v1::DIAGNOSTIC_LAYER_TECHNIQUES);
  EXPECT_NE(to_spec(spec, test::room()).error().message.find("mmlt"), std::string::npos);
  spec = good_spec();
  spec.add_layers(job::v1::DIAGNOSTIC_LAYER_UNSPECIFIED);
  EXPECT_NE(to_spec(spec, test::room()).error().message.find("layers"), std::string::npos);
}

TEST(ToSpec, TheShutterIsTheSensorsUnlessTheJobSaysOtherwise) {
  scene::SceneDescription scene = test::room();
  scene.sensor.shutter_open = 1;
  scene.sensor.shutter_close = 3;
  ResolvedSpec spec = good_spec();
  EXPECT_EQ(to_spec(spec, scene).value().shutter.close, 3);
  spec.set_shutter_open(0);
  spec.set_shutter_close(0.5);
  spec.set_shutter_curve(job::v1::SHUTTER_CURVE_TRAPEZOID);
  spec.set_shutter_ramp_open(0.25);
  spec.set_exposure(job::v1::EXPOSURE_CAMERA);
  spec.set_rolling_shutter(-0.25);
  const auto taken = to_spec(spec, scene);
  ASSERT_TRUE(taken.ok()) << taken.error().to_string();
  const sensor::ShutterSettings& s = taken.value().shutter;
  EXPECT_EQ(s.open, 0);
  EXPECT_EQ(s.close, 0.5);
  EXPECT_EQ(s.curve, sensor::ShutterCurve::kTrapezoid);
  EXPECT_EQ(s.ramp_open, 0.25);
  EXPECT_EQ(s.exposure, sensor::Exposure::kCamera);
  EXPECT_EQ(work_unit::interval_of(taken.value()), (motion::Interval{-0.25, 0.5}));
}

TEST(ToSpec, BadShuttersAreNamed) {
  EXPECT_EQ(error_after([](ResolvedSpec& s) {
              s.set_shutter_open(1);
              s.set_shutter_close(0.5);
            }),
            "spec: shutter_close must not be before shutter_open");
  EXPECT_EQ(error_after([](ResolvedSpec& s) { s.set_exposure(job::v1::EXPOSURE_CAMERA); }),
            "spec: exposure camera needs a shutter_close later than shutter_open");
  EXPECT_EQ(error_after([](ResolvedSpec& s) { s.add_shutter_samples(1); }),
            "spec: shutter_samples must be empty unless shutter_curve is tabulated");
  EXPECT_NE(error_after([](ResolvedSpec& s) {
              s.set_shutter_curve(static_cast<job::v1::ShutterCurve>(9));
            }),
            "");
}

TEST(ToSpec, PathTracingNeedsNoKernel) {
  EXPECT_EQ(error_after([](ResolvedSpec& s) {
              s.set_integrator(job::v1::INTEGRATOR_PATH);
              s.clear_kernel();
            }),
            "");
}

TEST(ToSpec, AFilterThatIsTooWideIsTheScenesError) {
  scene::SceneDescription scene = test::room();
  scene.film.filter_radius = 30;
  scene.film.where = {"scene.xml", 12};
  const auto spec = to_spec(good_spec(), scene);
  ASSERT_FALSE(spec.ok());
  EXPECT_EQ(spec.error().to_string().substr(0, 13), "scene.xml:12:");
}

TEST(ToReport, CountsWhatIsThere) {
  scene::SceneDescription description = test::room();
  description.warnings.push_back({"odd", {"scene.xml", 3}});
  const transport::Scene scene(std::move(description), "avx2");
  const auto report = to_report(scene, {1.5, 0.25});
  EXPECT_EQ(report.width(), 16U);
  EXPECT_EQ(report.filter(), metrofarm::scene::v1::FILTER_BOX);
  EXPECT_EQ(report.filter_radius(), 0.5);
  EXPECT_EQ(report.triangles(), 16U);
  EXPECT_EQ(report.analytic_shapes(), 3U);
  EXPECT_EQ(report.emitters().at("area"), 2U);
  EXPECT_EQ(report.emitters().at("point"), 1U);
  EXPECT_EQ(report.bsdfs().at("diffuse"), 2U);
  EXPECT_EQ(report.bsdfs().at("twosided"), 1U);
  EXPECT_EQ(report.load_seconds(), 1.5);
  EXPECT_EQ(report.structure().extended_lights(), 2U);
  ASSERT_EQ(report.warnings_size(), 1);
  EXPECT_EQ(report.warnings(0), "scene.xml:3: odd");
  EXPECT_GT(report.memory_bytes(), 0U);
}

// Two turns are followed, three hundred need more steps than there are.
TEST(ToReport, TellsOfWhatStepsCannotFollow) {
  for (const double turns : {2.0, 300.0}) {
    scene::SceneDescription description = test::room();
    description.sensor.shutter_close = 1;
    scene::Shape& ball = description.shapes[2];
    ball.where = {"scene.xml", 12};
    ball.motion.keys.resize(2);
    ball.motion.keys[1].time = 1;
    for (scene::Keyframe& key : ball.motion.keys) key.turns = {{{0, 1, 0}, 360 * turns * key.time}};
    const auto report = to_report(transport::Scene(std::move(description), "avx2"), {});
    ASSERT_EQ(report.warnings_size(), turns > 2 ? 1 : 0);
    if (turns == 2) continue;
    EXPECT_TRUE(report.warnings(0).starts_with(
        "scene.xml:12: while the shutter is open this moves more than 129 steps can follow: it is "
        "up to "))
        << report.warnings(0);
  }
}

// The report comes before any spec: what the worker cannot serve must not end it.
TEST(ToReport, SurvivesAFilterThatIsTooWide) {
  scene::SceneDescription description = test::room();
  description.film.filter = scene::ReconstructionFilter::kTent;
  description.film.filter_radius = 30;
  const transport::Scene scene(std::move(description), "avx2");
  EXPECT_EXIT(
      {
        to_report(scene, {});
        std::exit(0);
      },
      testing::ExitedWithCode(0), "");
}

TEST(FillCounts, TakesEveryCount) {
  work_unit::SegmentOutput output;
  output.counts = {1, 2, 3, 4, 5, 6, 7, 20, 21, 8, 9, 10, 11, 12, {}, {}, {13, 14, 15}};
  output.counts.lengths.proposed[2] = 16;
  output.counts.lengths.accepted[2] = 17;
  output.counts.techniques.proposed[work_unit::Shares::kLargest] = 18;
  output.counts.techniques.accepted[1] = 19;
  output.anomalies.count(diagnostics::AnomalyKind::kNegative);
  farm::v1::SegmentCounts counts;
  fill_counts(output, counts);
  EXPECT_EQ(counts.mutations(), 1U);
  EXPECT_EQ(counts.path_evaluations(), 2U);
  EXPECT_EQ(counts.rays(), 3U);
  EXPECT_EQ(counts.large_steps(), 4U);
  EXPECT_EQ(counts.large_accepted(), 5U);
  EXPECT_EQ(counts.small_steps(), 6U);
  EXPECT_EQ(counts.small_accepted(), 7U);
  EXPECT_EQ(counts.subpath_steps(), 20U);
  EXPECT_EQ(counts.subpath_accepted(), 21U);
  EXPECT_EQ(counts.second_stages(), 8U);
  EXPECT_EQ(counts.second_accepted(), 9U);
  EXPECT_EQ(counts.second_after_large(), 10U);
  EXPECT_EQ(counts.second_after_large_accepted(), 11U);
  EXPECT_EQ(counts.coordinates(), 12U);
  EXPECT_EQ(counts.longest_stay(), 13U);
  EXPECT_EQ(counts.chains_trapped(), 14U);
  EXPECT_EQ(counts.chains_freed(), 15U);
  ASSERT_EQ(counts.proposed_by_length_size(), 3);
  ASSERT_EQ(counts.accepted_by_length_size(), 3);
  EXPECT_EQ(counts.proposed_by_length(2), 16U);
  EXPECT_EQ(counts.accepted_by_length(2), 17U);
  ASSERT_EQ(counts.proposed_by_technique_size(), 33);
  ASSERT_EQ(counts.accepted_by_technique_size(), 33);
  EXPECT_EQ(counts.proposed_by_technique(32), 18U);
  EXPECT_EQ(counts.accepted_by_technique(1), 19U);
  ASSERT_EQ(counts.anomalies_size(), 5);
  EXPECT_EQ(counts.anomalies(farm::v1::ANOMALY_KIND_NEGATIVE), 1U);
}

TEST(FillAnomaly, KeepsKindPlaceAndSample) {
  farm::v1::Anomaly out;
  fill_anomaly({{diagnostics::AnomalyKind::kInfinite, diagnostics::Place::kEmitterSample, 4, 1},
                {7, 8, 0, 9}},
               out);
  EXPECT_EQ(out.kind(), farm::v1::ANOMALY_KIND_INFINITE);
  EXPECT_EQ(out.place(), "emitter_sample");
  EXPECT_EQ(out.depth(), 4U);
  ASSERT_EQ(out.primary_sample_size(), 4);
  EXPECT_EQ(out.primary_sample(3), 9U);
}

}  // namespace
}  // namespace metrofarm::rpc
