// Light sampling from a reference point against the density that LightTable states for the
// direction in which a light is met.
#include "emitter/light_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "geometry/tracer.h"
#include "tests/support/histogram.h"
#include "tests/support/lane_tools.h"
#include "tests/support/scenes.h"
#include "tests/support/statistics.h"

namespace metrofarm::emitter {
namespace {

using test::Double3;
using test::Histogram;
using test::SceneBuilder;

struct Case {
  std::string name;
  scene::SceneDescription scene;
  Double3 reference;
  // The part of the sphere that the histogram covers: an axis and 1 - cos of the half-angle.
  Double3 axis = {0, 0, 1};
  double one_minus_cos = 2;
};

Case make(std::string name, SceneBuilder& builder, Double3 reference) {
  return {std::move(name), builder.take(), reference};
}

Case narrow(Case c, Double3 axis, double one_minus_cos) {
  c.axis = normalize(axis);
  c.one_minus_cos = one_minus_cos;
  return c;
}

Case mesh_case(bool flip) {
  SceneBuilder b;
  b.shape(test::box({-1, -0.5, 1}, {1.5, 0.5, 2}), b.diffuse(0.5F), b.area_light(3), flip);
  return make(flip ? "inside_a_box" : "outside_a_box", b,
              flip ? Double3{0.3, 0.1, 1.7} : Double3{-1.5, 1.2, 0.2});
}

Case sphere_case(std::string name, Double3 reference, bool flip) {
  SceneBuilder b;
  b.shape(scene::Sphere{{0.2, -0.1, 0.3}, 1.5}, b.diffuse(0.5F), b.area_light(2), flip);
  return make(std::move(name), b, reference);
}

Case disk_case() {
  SceneBuilder b;
  const double s = std::sqrt(0.5);
  // An ellipse, tilted about x.
  scene::Disk tilted{{1.5, 0, 0, 0.5, 0, 0.4 * s, -s, 0, 0, 0.4 * s, s, -0.5, 0, 0, 0, 1}};
  b.shape(tilted, b.diffuse(0.5F), b.area_light(1));
  return narrow(make("disk", b, {0.1, -1.2, 0.6}), {0.4, 1.7, -1.1}, 0.4);
}

Case constant_case() {
  SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{1, 2, 3}});
  b.shape(scene::Sphere{{2, 0, 0}, 1}, b.diffuse(0.5F));
  return make("environment_partly_hidden", b, {0, 0, 0});
}

Case several_case() {
  SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.emitter(scene::ConstantEmitter{{0.3F, 0.3F, 0.3F}});
  b.shape(scene::Sphere{{2, 0, 0.5}, 0.7}, grey, b.area_light(4));
  b.shape(test::quad({-1, -1, -2}, {2, 0, 0}, {0, 2, 0}), grey, b.area_light(2));
  b.shape(test::disk({0, 0, 3}, 0.8, true), grey, b.area_light(5));
  b.shape(scene::Sphere{{1, 0, 0.2}, 0.2}, grey);
  return make("several_partly_hidden", b, {0, 0, 0.1});
}

std::vector<Case> all_cases() {
  std::vector<Case> cases = {mesh_case(false),
                             mesh_case(true),
                             sphere_case("sphere_from_outside", {2.5, 1, 0.4}, false),
                             sphere_case("sphere_from_inside", {0.9, 0.3, -0.4}, true),
                             disk_case(),
                             constant_case(),
                             several_case()};
  cases.push_back(
      narrow(sphere_case("sphere_from_afar", {300.2, -0.1, 0.3}, false), {-1, 0, 0}, 1.4e-5));
  cases.push_back(
      narrow(sphere_case("sphere_from_very_near", {1.7008, -0.1, 0.3}, false), {-1, 0, 0}, 1));
  return cases;
}

class LightTableTest : public testing::TestWithParam<Case> {
 protected:
  LightTableTest()
      : scene_(GetParam().scene),
        primitives_(geometry::build_primitives(scene_)),
        tracer_(primitives_, "avx2"),
        lights_(scene_, primitives_),
        reference_(test::splat(GetParam().reference)),
        frame_(frame_around(test::splat(GetParam().axis))) {}

  // What a ray from the reference point meets: radiance and the density of choosing its direction.
  struct Seen {
    Spectrum radiance;
    Float pdf_solid_angle;
  };
  Seen look(const Vec3& direction) const;
  bool visible(const LightSample& s, int lane) const;
  std::pair<double, double> locate(Double3 direction) const;
  Vec3 direction_at(Float u, Float v) const;
  Histogram expected_counts(double samples) const;

  scene::SceneDescription scene_;
  geometry::Primitives primitives_;
  geometry::Tracer tracer_;
  LightTable lights_;
  Vec3 reference_;
  Frame frame_;
};

LightTableTest::Seen LightTableTest::look(const Vec3& direction) const {
  const geometry::RayHits hits = tracer_.intersect(all_lanes(), reference_, direction);
  const geometry::Surface surface =
      geometry::surface_at(primitives_, hits, reference_, direction, false);
  Seen seen;
  seen.radiance = lights_.emitted(surface, direction, hits.hit);
  const Mask lit = hits.hit & (max_component(seen.radiance) > Float(0.F));
  seen.pdf_solid_angle = keep(lit, lights_.pdf_of_hit(reference_, hits, surface, direction, lit));
  if (lights_.has_environment()) {
    seen.radiance = select(hits.hit, seen.radiance, lights_.environment());
    seen.pdf_solid_angle = select(hits.hit, seen.pdf_solid_angle, lights_.environment_pdf());
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
    const LightSample s = lights_.sample(reference_, random.next(), random.pair(), all_lanes());
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
    const LightSample s = lights_.sample(reference_, random.next(), random.pair(), all_lanes());
    const Seen seen = look(s.direction);
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!visible(s, lane)) continue;
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
    const LightSample s = lights_.sample(reference_, random.next(), random.pair(), all_lanes());
    for (int lane = 0; lane < kLanes; ++lane) {
      if (test::lane_set(s.valid, lane)) {
        EXPECT_NEAR(length(test::lane_of(s.direction, lane)), 1, 1e-6);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Lights, LightTableTest, testing::ValuesIn(all_cases()),
                         [](const auto& tested) { return tested.param.name; });

}  // namespace
}  // namespace metrofarm::emitter
