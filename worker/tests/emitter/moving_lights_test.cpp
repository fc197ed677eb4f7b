// Lights that move: at every time they are what the same lights are that stand there.
#include <gtest/gtest.h>

#include <cmath>

#include "geometry/tracer.h"
#include "tests/emitter/lights.h"
#include "tests/motion/motions.h"
#include "tests/support/lane_tools.h"
#include "tests/support/statistics.h"

namespace metrofarm::emitter {
namespace {

using motion::test::scaled;
using motion::test::translated;
using motion::test::turned;
using test::Lights;

constexpr int kSamples = 40000;
constexpr double kPiDouble = std::numbers::pi;

scene::Motion motion_of(const scene::Matrix& a, const scene::Matrix& b) {
  return {{{0, a}, {1, b}}};
}

// The light that lane 0 meets on a ray, as seen from the receiver: density and radiance.
struct Met {
  bool hit;
  double pdf, radiance;
};

class MovingLight {
 public:
  explicit MovingLight(scene::SceneDescription d)
      : lights_(std::move(d), {0, 1}), tracer_(lights_.primitives, lights_.placements, "avx2") {}

  const LightTable& table() const { return lights_.table; }

  Met look(const Receiver& from, const Vec3& direction) const {
    const geometry::RayHits hits =
        tracer_.intersect(all_lanes(), from.position, direction, from.time);
    const geometry::Surface s = geometry::surface_at(lights_.primitives, lights_.placements, hits,
                                                     from.position, direction, {.uv = true});
    return {test::lane_set(hits.hit, 0),
            lane_value(table().pdf_of_hit(from, hits, s, direction, hits.hit), 0),
            lane_value(table().emitted(s, direction, hits.hit).y, 0)};
  }

 private:
  Lights lights_;
  geometry::Tracer tracer_;
};

struct Case {
  const char* name;
  scene::SceneDescription scene;
  double flux;  // at all times
};

scene::SceneDescription lamp(test::SceneBuilder b, const scene::Motion& motion) {
  b.description().shapes.back().motion = motion;
  return b.take();
}

std::vector<Case> rigid_cases() {
  const scene::Motion motion = motion_of(
      translated(1, 0, 0), motion::multiply(translated(-1, 2, 0), turned({1, 1, 0}, 100)));
  std::vector<Case> all;
  test::SceneBuilder quad;
  quad.shape(test::quad({-1, -0.5, 0}, {2, 0, 0}, {0, 1, 0}), quad.diffuse(0), quad.area_light(3));
  all.push_back({"Quad", lamp(quad, motion), kPiDouble * 2 * 3});
  test::SceneBuilder sphere;
  sphere.shape(scene::Sphere{{0.5, 0, 0}, 0.5}, sphere.diffuse(0), sphere.area_light(3));
  all.push_back({"Sphere", lamp(sphere, motion), kPiDouble * kPiDouble * 3});
  test::SceneBuilder disk;
  disk.shape(test::disk({0, 0.5, 0}, 0.5), disk.diffuse(0), disk.area_light(3));
  all.push_back({"Disk", lamp(disk, motion), kPiDouble * kPiDouble * 0.25 * 3});
  test::SceneBuilder cylinder;
  cylinder.shape(scene::Cylinder{scaled(0.5, 0.5, 2)}, cylinder.diffuse(0), cylinder.area_light(3));
  all.push_back({"Cylinder", lamp(cylinder, motion), kPiDouble * 2 * kPiDouble * 3});
  test::SceneBuilder point;
  point.emitter(scene::PointEmitter{{0, 1, 0}, {2, 2, 2}});
  point.description().emitters[0].motion = motion;
  all.push_back({"Point", point.take(), 8 * kPiDouble});
  test::SceneBuilder spot;
  spot.emitter(scene::SpotEmitter{turned({1, 0, 0}, 40), {{2, 2, 2}}, 30, 30});
  spot.description().emitters[0].motion = motion;
  all.push_back({"Spot", spot.take(), 4 * kPiDouble * (1 - std::cos(kPiDouble / 6))});
  return all;
}

// H0: emitted rays carry the light's power at every time. 40,000 rays each, rate 1e-6.
TEST(MovingLights, FluxIsConserved) {
  for (const Case& c : rigid_cases()) {
    const Lights lights(c.scene, {0, 1});
    for (float time : {0.F, 0.4F, 1.F}) {
      test::UniformLanes random(3);
      test::Moments power;
      for (int i = 0; i < kSamples; i += kLanes) {
        const Float choice = random.next();
        const Vec2 position = random.pair(), direction = random.pair();
        const Emission e = lights.table.emit(choice, position, direction, Float(time), all_lanes());
        for (int lane = 0; lane < kLanes; ++lane)
          power.add(test::lane_set(e.valid, lane) ? lane_value(e.power.y, lane) : 0.0);
      }
      EXPECT_TRUE(test::has_mean(power, c.flux, 1e-6, 1e-4 * c.flux)) << c.name << " " << time;
    }
  }
}

// Also of lights that change their size, whose power does: the integral over the surface is the
// area at the time.
TEST(MovingLights, EmittedPowerFollowsTheArea) {
  struct Sized {
    scene::SceneDescription scene;
    double (*area)(double time);
  };
  std::vector<Sized> all;
  test::SceneBuilder quad;
  quad.shape(test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), quad.diffuse(0), quad.area_light(1));
  all.push_back({lamp(quad, motion_of(scaled(1, 1, 1), scaled(3, 2, 1))),
                 [](double t) { return (1 + 2 * t) * (1 + t); }});
  test::SceneBuilder bent;
  scene::TriangleMesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.keys = {{mesh.positions, {}}, {test::quad({0, 0, 0}, {2, 0, 0}, {0, 3, 0}).positions, {}}};
  bent.shape(mesh, bent.diffuse(0), bent.area_light(1));
  bent.description().shapes[0].key_times = {0, 1};
  all.push_back({bent.take(), [](double t) { return (1 + t) * (1 + 2 * t); }});
  for (const Sized& s : all) {
    const Lights lights(s.scene, {0, 1});
    for (float time : {0.F, 0.5F, 1.F}) {
      test::UniformLanes random(3);
      test::Moments power;
      for (int i = 0; i < kSamples; i += kLanes) {
        const Emission e = lights.table.emit(random.next(), random.pair(), random.pair(),
                                             Float(time), all_lanes());
        for (int lane = 0; lane < kLanes; ++lane)
          power.add(test::lane_set(e.valid, lane) ? lane_value(e.power.y, lane) : 0.0);
      }
      const double flux = kPiDouble * s.area(double(time));
      EXPECT_TRUE(test::has_mean(power, flux, 1e-6, 1e-4 * flux)) << time;
    }
  }
}

// A lamp whose first key is a point is a lamp from then on: of area 4 t^2.
TEST(MovingLights, MayGrowFromAPoint) {
  test::SceneBuilder b;
  scene::TriangleMesh mesh = test::quad({0, 0, 0}, {0, 0, 0}, {0, 0, 0});
  mesh.keys = {{mesh.positions, {}}, {test::quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}).positions, {}}};
  b.shape(mesh, b.diffuse(0), b.area_light(1));
  b.description().shapes[0].key_times = {0, 1};
  const scene::SceneDescription scene = b.take();
  const Lights lights(scene, {0, 1});
  ASSERT_FALSE(lights.table.empty()) << "rays that meet it ask for densities";
  for (float time : {0.25F, 0.5F, 1.F}) {
    test::UniformLanes random(3);
    test::Moments power;
    for (int i = 0; i < kSamples; i += kLanes) {
      const Emission e =
          lights.table.emit(random.next(), random.pair(), random.pair(), Float(time), all_lanes());
      for (int lane = 0; lane < kLanes; ++lane)
        power.add(test::lane_set(e.valid, lane) ? lane_value(e.power.y, lane) : 0.0);
    }
    const double flux = kPiDouble * 4 * double(time) * double(time);
    EXPECT_TRUE(test::has_mean(power, flux, 1e-6, 1e-4 * flux)) << time;
  }
  // Light sampling and rays agree on densities.
  const MovingLight light(scene);
  const Receiver receiver = {splat(0.1F, 0.2F, 2), splat(0.F), Float(0.5F)};
  test::UniformLanes random(5);
  int compared = 0;
  for (int i = 0; i < 20; ++i) {
    const LightSample s = light.table().sample(receiver, random.next(), random.pair(), all_lanes());
    ASSERT_TRUE(test::lane_set(s.valid, 0));
    const Met met = light.look(receiver, test::splat(test::lane_of(s.direction, 0)));
    if (!met.hit) continue;  // at its very edge
    ++compared;
    EXPECT_NEAR(met.pdf / lane_value(s.pdf_solid_angle, 0), 1, 1e-2);
  }
  EXPECT_GT(compared, 15);
}

std::vector<scene::SceneDescription> area_lights() {
  std::vector<scene::SceneDescription> all;
  for (const Case& c : rigid_cases())
    if (!c.scene.shapes.empty()) all.push_back(c.scene);
  const scene::Motion squeezed =
      motion_of(scaled(1, 1, 1), motion::multiply(turned({0, 1, 1}, 60), scaled(2, 0.5, 1)));
  for (size_t i = 0; i < 3; ++i) {
    all.push_back(all[i]);
    all.back().shapes[0].motion = squeezed;
  }
  test::SceneBuilder bent;
  scene::TriangleMesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  mesh.keys = {{mesh.positions, {}}, {test::quad({0, 0, 1}, {2, 0, 0}, {1, 3, 1}).positions, {}}};
  bent.shape(mesh, bent.diffuse(0), bent.area_light(1));
  bent.description().shapes[0].key_times = {0, 1};
  all.push_back(bent.take());
  return all;
}

// Light sampling finds what rays meet at its time: the density it states is that of the hit, and
// the mean of radiance over density is that of rays in all directions.
TEST(MovingLights, SamplesAreWhatRaysMeet) {
  for (const scene::SceneDescription& scene : area_lights()) {
    const MovingLight light(scene);
    for (float time : {0.F, 0.35F, 1.F}) {
      const Receiver receiver = {splat(0.5F, -1, 2.5F), splat(0.F), Float(time)};
      test::UniformLanes random(11);
      test::Moments sampled, met;
      int looked = 0, missed = 0;
      for (int i = 0; i < 6000; ++i) {
        const LightSample s =
            light.table().sample(receiver, random.next(), random.pair(), all_lanes());
        for (int lane = 0; lane < kLanes; ++lane)
          sampled.add(test::lane_set(s.valid, lane) ? lane_value(s.value.y, lane) : 0.0);
        const Vec3 direction = random.direction();
        met.add(4 * kPiDouble * light.look(receiver, direction).radiance);
        if (i >= 400 || !test::lane_set(s.valid, 0) || lane_value(xsimd::abs(s.cosine), 0) < 0.15)
          continue;
        ++looked;
        const Met at = light.look(receiver, test::splat(test::lane_of(s.direction, 0)));
        // The ray that looks where a sample lies meets a curved light at a slightly different
        // place, which a grazing view magnifies.
        if (!at.hit || std::fabs(at.pdf / lane_value(s.pdf_solid_angle, 0) - 1) > 1e-2) ++missed;
      }
      if (looked > 0) {
        EXPECT_LE(missed, looked / 50) << time;
      }
      EXPECT_TRUE(test::same_mean(sampled, met, 1e-6)) << time;
    }
  }
}

// Lights without extent against the same lights where they stand. Steps follow a motion to a
// ten-thousandth of the scene's size, which is 10.
TEST(MovingLights, DeltaLightsStandWhereTheyAreAtTheTime) {
  const scene::Motion motion = motion_of(
      translated(1, 0, 0), motion::multiply(translated(-1, 2, 0), turned({1, 1, 0}, 100)));
  const scene::Matrix own = motion::multiply(translated(0, 0.5, 0), turned({1, 0, 0}, 30));
  const std::vector<scene::Emitter> emitters = {
      {scene::PointEmitter{{0, 1, 0}, {2, 2, 2}}, {}},
      {scene::SpotEmitter{own, {{2, 2, 2}}, 60, 20}, {}},
      {scene::ProjectorEmitter{own, {{2, 2, 2}}, 80, 1.5}, {}},
      {scene::DirectionalEmitter{{0.5, 0.2, 1}, {2, 2, 2}}, {}}};
  for (const scene::Emitter& emitter : emitters) {
    test::SceneBuilder moving;
    moving.shape(scene::Sphere{{0, 0, 0}, 3}, moving.diffuse(0.5F));
    scene::SceneDescription still = moving.description();
    moving.description().emitters = {emitter};
    moving.description().emitters[0].motion = motion;
    const Lights lights(moving.take(), {0, 1});
    EXPECT_TRUE(lights.table.anything_moves());
    for (float time : {0.F, 0.3F, 1.F}) {
      // Its keys hold one pose: what stands still is another way through the code.
      const scene::Matrix pose = motion::Track(motion).at(double(time));
      still.emitters = {emitter};
      still.emitters[0].motion = motion_of(pose, pose);
      const Lights there(still, {0, 1});
      EXPECT_FALSE(there.table.anything_moves());
      test::UniformLanes random(8);
      for (int i = 0; i < 60; ++i) {
        const Vec3 at = random.direction() * Float(2.F);
        const LightSample a =
            lights.table.sample({at, splat(0.F), Float(time)}, Float(0.5F), {}, all_lanes());
        const LightSample b = there.table.sample({at}, Float(0.5F), {}, all_lanes());
        const Vec2 position = random.pair(), direction = random.pair();
        const Emission e =
            lights.table.emit(Float(0.5F), position, direction, Float(time), all_lanes());
        const Emission f =
            there.table.emit(Float(0.5F), position, direction, Float(0.F), all_lanes());
        for (int lane = 0; lane < kLanes; ++lane) {
          if (test::lane_set(a.valid & b.valid, lane)) {
            EXPECT_NEAR(lane_value(a.value.y, lane), lane_value(b.value.y, lane),
                        2e-3 + 5e-3 * lane_value(b.value.y, lane));
            EXPECT_NEAR(test::length(test::lane_of(a.direction - b.direction, lane)), 0, 2e-3);
          }
          EXPECT_NEAR(lane_value(e.pdf / f.pdf, lane), 1, 1e-3);
          EXPECT_NEAR(test::length(test::lane_of(e.direction - f.direction, lane)), 0, 1e-3);
          EXPECT_NEAR(test::length(test::lane_of(e.origin - f.origin, lane)), 0, 5e-3);
        }
      }
    }
  }
}

}  // namespace
}  // namespace metrofarm::emitter
