// Numbers that cannot be light are kept out of the image, counted, and never stop the render.
#include <gtest/gtest.h>

#include <limits>

#include "tests/support/trace.h"

namespace metrofarm::transport {
namespace {

using diagnostics::AnomalyKind;
using test::SceneBuilder;
using test::Traced;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// A floor lit by a good light, and a bad one beside it.
scene::SceneDescription with_bad_light(const scene::Rgb& radiance) {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(test::quad({-3, -1, 0}, {0, 0, 8}, {6, 0, 0}), grey);
  b.shape(test::quad({-2, 2, 2}, {1, 0, 0}, {0, 0, 2}), grey, b.area_light(5));
  b.shape(test::quad({1, 2, 2}, {1, 0, 0}, {0, 0, 2}), grey,
          b.emitter(scene::AreaEmitter{radiance}));
  b.camera({0, 0, -2}, 70);
  return b.take();
}

uint64_t total(const Traced& traced) {
  uint64_t sum = 0;
  for (uint64_t n : traced.anomalies) sum += n;
  return sum;
}

uint64_t count(const Traced& traced, AnomalyKind kind) {
  return traced.anomalies[static_cast<size_t>(kind)];
}

TEST(Anomalies, AnInfiniteLightIsCountedAndKeptOut) {
  const Traced t =
      test::trace_paths(with_bad_light({kInfinity, kInfinity, kInfinity}), {}, 16000, 1);
  EXPECT_EQ(t.bad, 0U);
  EXPECT_GT(total(t), 0U);
  EXPECT_GT(t.all.mean(), 0) << "the good light still shines";
}

TEST(Anomalies, ANotANumberLightIsCountedAndKeptOut) {
  for (const scene::Rgb& radiance : {scene::Rgb{kNan, kNan, kNan}, {1, kNan, 1}}) {
    const Traced t = test::trace_paths(with_bad_light(radiance), {}, 16000, 2);
    EXPECT_EQ(t.bad, 0U);
    EXPECT_GT(count(t, AnomalyKind::kNan), 0U);
    EXPECT_GT(t.all.mean(), 0) << "the good light still shines";
  }
}

scene::SceneDescription with_bad_floor(const scene::Rgb& reflectance) {
  SceneBuilder b;
  b.shape(test::quad({-3, -1, 0}, {0, 0, 8}, {6, 0, 0}), b.material(scene::Diffuse{reflectance}));
  b.shape(test::quad({-2, 2, 2}, {4, 0, 0}, {0, 0, 2}), b.diffuse(0.5F), b.area_light(5));
  b.camera({0, 0, -2}, 70);
  return b.take();
}

TEST(Anomalies, ANotANumberMaterialIsCounted) {
  for (LightSampling mode : {LightSampling::kMis, LightSampling::kBsdf}) {
    PathSettings settings;
    settings.light_sampling = mode;
    const Traced t = test::trace_paths(with_bad_floor({kNan, kNan, kNan}), settings, 16000, 4);
    EXPECT_EQ(t.bad, 0U);
    EXPECT_GT(count(t, AnomalyKind::kNan), 0U);
  }
}

TEST(Anomalies, ANegativeMaterialIsCounted) {
  for (const scene::Rgb& reflectance : {scene::Rgb{-0.5F, -0.5F, -0.5F}, {0.5F, -0.5F, 0.5F}}) {
    const Traced t = test::trace_paths(with_bad_floor(reflectance), {}, 16000, 5);
    EXPECT_EQ(t.bad, 0U);
    EXPECT_GT(count(t, AnomalyKind::kNegative), 0U);
  }
}

TEST(Anomalies, OnlyTheBadContributionIsLost) {
  const Vec3 value = {Float(1.F), Float(2.F), Float(3.F)};
  Vec3 mixed = value;
  set_lane_value(mixed.y, 2, kNan);
  set_lane_value(mixed.x, 4, -1);
  set_lane_value(mixed.z, 6, kInfinity);
  EXPECT_EQ(bits(diagnostics::sound(mixed)), 0b10101011U);
  std::vector<diagnostics::Incident> incidents;
  diagnostics::report(~diagnostics::sound(mixed), mixed, diagnostics::Place::kEmission, 7,
                      incidents);
  ASSERT_EQ(incidents.size(), 3U);
  EXPECT_EQ(incidents[0].kind, AnomalyKind::kNan);
  EXPECT_EQ(incidents[0].lane, 2);
  EXPECT_EQ(incidents[1].kind, AnomalyKind::kNegative);
  EXPECT_EQ(incidents[1].lane, 4);
  EXPECT_EQ(incidents[2].kind, AnomalyKind::kInfinite);
  EXPECT_EQ(incidents[2].depth, 7);
}

TEST(AnomalyLog, CountsAllAndKeepsSome) {
  diagnostics::AnomalyLog log, other;
  for (int i = 0; i < 100; ++i) {
    other.count(AnomalyKind::kInfinite);
    if (other.wants_sample()) other.keep({{}, {1, 2}});
  }
  log.count(AnomalyKind::kNan);
  log.merge(other);
  log.merge(other);
  EXPECT_EQ(log.counts()[static_cast<size_t>(AnomalyKind::kInfinite)], 200U);
  EXPECT_EQ(log.counts()[static_cast<size_t>(AnomalyKind::kNan)], 1U);
  EXPECT_EQ(log.samples().size(), diagnostics::AnomalyLog::kSamples);
}

}  // namespace
}  // namespace metrofarm::transport
