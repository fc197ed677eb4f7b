// Light sampling from a reference point against the density that LightTable states for the
// direction in which a light is met.
#include "emitter/light_table.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/tracer.h"
#include "tests/emitter/light_cases.h"
#include "tests/emitter/lights.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::emitter {
namespace {

using test::Double3;
using test::Histogram;

class LightTableTest : public testing::TestWithParam<test::LightCase> {
 protected:
  LightTableTest()
      : all_(GetParam().scene),
        primitives_(all_.primitives),
        tracer_(primitives_, all_.placements, "avx2"),
        lights_(all_.table),
        reference_(test::splat(GetParam().reference)),
        receiver_{reference_, splat(0.6F, 0, 0.8F)},
        frame_(frame_around(test::splat(GetParam().axis))) {}

  // What a ray from the reference point meets: radiance and the density of choosing its direction.
  struct Seen {
    Spectrum radiance;
    Float pdf_solid_angle;
    Float cosine;  // 0 where nothing is hit
  };
  Seen look(const Vec3& direction) const;
  bool visible(const LightSample& s, int lane) const;
  std::pair<double, double> locate(Double3 direction) const;
  Vec3 direction_at(Float u, Float v) const;
  Histogram expected_counts(double samples) const;

  test::Lights all_;
  const geometry::Primitives& primitives_;
  geometry::Tracer tracer_;
  const LightTable& lights_;
  Vec3 reference_;
  Receiver receiver_;
  Frame frame_;
};

LightTableTest::Seen LightTableTest::look(const Vec3& direction) const {
  const geometry::RayHits hits = tracer_.intersect(all_lanes(), reference_, direction);
  const geometry::Surface surface = geometry::surface_at(
      primitives_, all_.placements, hits, reference_, direction, {.uv = lights_.wants_uv()});
  Seen seen;
  seen.cosine = select(hits.hit, xsimd::abs(dot(surface.geometric_normal, direction)), Float(0.F));
  seen.radiance = lights_.emitted(surface, direction, hits.hit);
  const Mask lit = hits.hit & (max_component(seen.radiance) > Float(0.F));
  seen.pdf_solid_angle = keep(lit, lights_.pdf_of_hit(receiver_, hits, surface, direction, lit));
  if (lights_.has_environment()) {
    seen.radiance = select(hits.hit, seen.radiance, lights_.environment(direction, all_lanes()));
    seen.pdf_solid_angle =
        select(hits.hit, seen.pdf_solid_angle, lights_.environment_pdf(direction, all_lanes()));
  }
  return seen;
}

bool LightTableTest::visible(const LightSample& s, int lane) const {
  if (!test::lane_set(s.valid, lane)) return false;
  const float distance = std::min(lane_value(s.distance, lane), 1e30F);
  const Vec3 direction = test::splat(test::lane_of(s.direction, lane));
  return none(tracer_.occluded(all_lanes(), reference_, direction, Float(distance)));
}

// (1 - cos) / (1 - cos of the half-angle) and azimuth about the axis.
std::pair<double, double> LightTableTest::locate(Double3 direction) const {
  const Double3 s = test::lane_of(frame_.s, 0), t = test::lane_of(frame_.t, 0);
  const Double3 n = test::lane_of(frame_.n, 0);
  const double x = dot(direction, s), y = dot(direction, t), z = dot(direction, n);
  const double r2 = x * x + y * y;
  const double drop = z > 0 ? r2 / (1 + std::sqrt(1 - std::min(r2, 1.0))) : 1 - z;
  return {drop / GetParam().one_minus_cos, test::turns(x, y)};
}

Vec3 LightTableTest::direction_at(Float u, Float v) const {
  const Float drop = u * Float(static_cast<float>(GetParam().one_minus_cos));
  const Float r = safe_sqrt(drop * (Float(2.F) - drop));
  Float cosine(0.F), sine(0.F);
  for (int lane = 0; lane < kLanes; ++lane) {
    const double angle = 2 * std::numbers::pi * lane_value(v, lane);
    set_lane_value(cosine, lane, static_cast<float>(std::cos(angle)));
    set_lane_value(sine, lane, static_cast<float>(std::sin(angle)));
  }
  return frame_.to_world({r * cosine, r * sine, Float(1.F) - drop});
}

// Stratified, one random direction in each of 32 x 32 parts of every cell.
Histogram LightTableTest::expected_counts(double samples) const {
  constexpr int kPerCell = 32;
  test::UniformLanes jitter(44);
  Histogram expected(24, 24);
  const int across = 24 * kPerCell;
  const double solid_angle =
      2 * std::numbers::pi * GetParam().one_minus_cos / (double(across) * across);
  for (int row = 0; row < across; ++row) {
    for (int first = 0; first < across; first += kLanes) {
      const Vec2 at = jitter.pair();
      const Float column =
          Float(_mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7)) + Float(float(first)) + at.x;
      const Seen seen = look(direction_at(column / Float(float(across)),
                                          (Float(float(row)) + at.y) / Float(float(across))));
      for (int lane = 0; lane < kLanes; ++lane) {
        const double pdf = lane_value(seen.pdf_solid_angle, lane);
        expected.add_to((first + lane) / kPerCell, row / kPerCell, samples * pdf * solid_angle);
      }
    }
  }
  expected.complete_to(samples);
  return expected;
}

// H0: visible samples are distributed with the density that pdf_of_hit() and environment_pdf()
// state where their direction meets a light. 100,000 samples on 24 x 24 cells, rate 1e-6 per case;
// the quadrature knows a cell on a light's outline to half a percent.
TEST_P(LightTableTest, SamplesFollowThePdfOfWhatTheyMeet) {
  constexpr int kSamples = 100000;
  Histogram observed(24, 24);
  test::UniformLanes random(41);
  for (int i = 0; i < kSamples; i += kLanes) {
    const LightSample s = lights_.sample(receiver_, random.next(), random.pair(), all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!visible(s, lane)) {
        observed.add_outside();
        continue;
      }
      const auto [u, v] = locate(test::lane_of(s.direction, lane));
      observed.add(u, v);
    }
  }
  const Histogram expected = expected_counts(kSamples);
  // What is left over for hidden and averted samples cannot be negative.
  EXPECT_GT(expected.counts().back(), -2e-3 * kSamples);
  EXPECT_TRUE(test::follows(observed.counts(), expected.counts(), 1e-6));
}

TEST_P(LightTableTest, TheSampledDirectionMeetsWhatWasSampled) {
  test::UniformLanes random(42);
  int compared = 0, differing = 0;
  for (int i = 0; i < 1000; ++i) {
    const LightSample s = lights_.sample(receiver_, random.next(), random.pair(), all_lanes());
    const Seen seen = look(s.direction);
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!visible(s, lane) || lane_value(seen.cosine, lane) < GetParam().least_cosine) continue;
      ++compared;
      const double pdf = lane_value(s.pdf_solid_angle, lane);
      const double pdf_there = lane_value(seen.pdf_solid_angle, lane);
      const double radiance = lane_value(seen.radiance.x, lane);
      const double value = lane_value(s.value.x, lane) * pdf;
      const bool same =
          std::fabs(pdf_there - pdf) < 2e-3 * pdf && std::fabs(value - radiance) < 1e-4 * radiance;
      differing += same ? 0 : 1;
    }
  }
  EXPECT_GT(compared, 500);
  // A sample at a light's very outline may be missed by its ray.
  EXPECT_LE(differing, compared / 500);
}

TEST_P(LightTableTest, DirectionsAreUnitVectors) {
  test::UniformLanes random(43);
  for (int i = 0; i < 200; ++i) {
    const LightSample s = lights_.sample(receiver_, random.next(), random.pair(), all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      if (test::lane_set(s.valid, lane)) {
        EXPECT_NEAR(length(test::lane_of(s.direction, lane)), 1, 1e-6);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Lights, LightTableTest, testing::ValuesIn(test::light_cases()),
                         [](const auto& tested) { return tested.param.name; });

}  // namespace
}  // namespace metrofarm::emitter
