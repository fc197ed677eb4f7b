#include <gtest/gtest.h>

#include "tests/support/room.h"
#include "tests/support/trace.h"

namespace metrofarm::transport {
namespace {

using test::Traced;

PathSettings with(LightSampling sampling, int max_depth) {
  PathSettings settings;
  settings.light_sampling = sampling;
  settings.max_depth = max_depth;
  return settings;
}

// A box lit by area lights of two sizes, with rough and smooth metal: nothing that only one way of
// sampling can find but the mirror's view of the lights.
scene::SceneDescription plates() {
  test::SceneBuilder b;
  scene::RoughConductor metal;
  metal.distribution = scene::Microfacet::kGgx;
  metal.alpha_u = 0.3F;
  metal.alpha_v = 0.1F;
  const scene::Index grey = b.diffuse(0.6F);
  b.shape(test::box({-2, -1, -2}, {2, 2, 4}), grey, scene::kNone, true);
  b.shape(test::quad({-1.5, -0.9, 0.5}, {0, 0, 2}, {3, 0, 0}), b.material(metal));
  b.shape(scene::Sphere{{0, -0.3, 2.8}, 0.5}, b.material(scene::Conductor{}));
  b.shape(test::quad({-1.5, 1.9, 1}, {1.2, 0, 0}, {0, 0, 1.2}), grey, b.area_light(3));
  b.shape(scene::Sphere{{1, 1, 2}, 0.3}, grey, b.area_light(5));
  b.shape(test::disk({-1, 0.5, 3.9}, 0.4, true), grey, b.area_light(4));
  b.camera({0, 0.3, -1.5}, 60);
  return b.take();
}

// H0: every way to find emitters has the same mean in every tile. Welch tests of 16 tiles and three
// pairs, about 12,000 paths per tile, family rate 1e-5.
TEST(LightSampling, AllModesAgree) {
  constexpr int kGrid = 4, kPaths = 200000;
  std::vector<Traced> modes;
  for (LightSampling mode : {LightSampling::kMis, LightSampling::kEmitter, LightSampling::kBsdf})
    modes.push_back(test::trace_paths(plates(), with(mode, 5), kPaths, 20 + modes.size(), kGrid));
  const double rate = test::sidak(1e-5, 3 * kGrid * kGrid);
  for (auto [a, b] : {std::pair{0, 1}, {0, 2}, {1, 2}}) {
    for (int t = 0; t < kGrid * kGrid; ++t)
      EXPECT_TRUE(test::same_mean(modes[a].tiles[t], modes[b].tiles[t], rate)) << "tile " << t;
  }
  EXPECT_LT(modes[0].all.variance(), modes[2].all.variance()) << "MIS is there for a reason";
}

// H0: Russian roulette doesn't change the mean. 16 tiles, family rate 1e-5.
TEST(Roulette, IsUnbiased) {
  PathSettings early = with(LightSampling::kMis, 8), late = early;
  early.rr_depth = 1;
  late.rr_depth = 100;
  const Traced a = test::trace_paths(test::room(), early, 160000, 31, 4);
  const Traced b = test::trace_paths(test::room(), late, 160000, 32, 4);
  for (size_t t = 0; t < a.tiles.size(); ++t)
    EXPECT_TRUE(test::same_mean(a.tiles[t], b.tiles[t], test::sidak(1e-5, 16))) << "tile " << t;
}

TEST(PathTracer, ACleanSceneReportsNothing) {
  const Traced traced = test::trace_paths(test::room(), {}, 80000, 33, 4);
  EXPECT_EQ(traced.bad, 0U);
  for (uint64_t n : traced.anomalies) EXPECT_EQ(n, 0U);
}

// Lanes don't know of each other: a path traced alone brings back what it does in company.
TEST(PathTracer, MaskedLanesChangeNothing) {
  const FlushDenormals flush;
  const Scene scene(test::room(), "avx2");
  const sensor::Camera camera(scene.description().sensor, scene.description().film, 8, 8);
  PathTracer tracer(scene, camera, {});
  primary_space::IndependentSource source(rng_key(3, RngDomain::kTest));
  const RasterWindow window{Float(0.F), Float(0.F), Float(8.F), Float(8.F)};
  int differing = 0;
  for (uint64_t i = 0; i < 400; i += kLanes) {
    source.begin(i);
    Contribution together, alone;
    tracer.trace(source, window, all_lanes(), together);
    for (int lane = 0; lane < kLanes; ++lane) {
      source.begin(i);
      tracer.trace(source, window, mask_from_bits(1U << lane), alone);
      const Float found = alone.total().y;
      if (lane_value(found, lane) != lane_value(together.total().y, lane)) ++differing;
      for (int other = 0; other < kLanes; ++other) {
        if (other == lane) continue;
        EXPECT_EQ(lane_value(found, other), 0.F);
      }
    }
  }
  // Where surfaces coincide a packet's composition may decide which is met.
  EXPECT_LE(differing, 4);
}

TEST(PathTracer, ReadsOnlyWhatAPathNeeds) {
  const FlushDenormals flush;
  test::SceneBuilder b;
  b.emitter(scene::ConstantEmitter{{1, 1, 1}});
  const Scene scene(b.take(), "avx2");
  const sensor::Camera camera(scene.description().sensor, scene.description().film, 8, 8);
  PathTracer tracer(scene, camera, {});
  primary_space::IndependentSource source(rng_key(3, RngDomain::kTest));
  source.begin(0);
  Contribution found;
  tracer.trace(source, {Float(0.F), Float(0.F), Float(8.F), Float(8.F)}, all_lanes(), found);
  ASSERT_EQ(source.read_pairs(0).size(), 1U);
  EXPECT_EQ(source.read_pairs(0)[0].slot, primary_space::kFilmSlot);
}

}  // namespace
}  // namespace metrofarm::transport
