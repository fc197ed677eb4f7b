// What the shutter does to images: brightness, rows, and that all techniques share one time.
#include <gtest/gtest.h>

#include "tests/motion/motions.h"
#include "tests/support/statistics.h"
#include "tests/support/trace.h"
#include "transport/multiplexed.h"

namespace metrofarm::transport {
namespace {

using motion::test::translated;
using primary_space::IndependentSource;

// A floor, a ball and a lamp that both move, seen from aside.
scene::SceneDescription scene_in_motion() {
  test::SceneBuilder b;
  b.shape(test::quad({-3, -1, -1}, {0, 0, 6}, {6, 0, 0}), b.diffuse(0.7F));
  b.shape(scene::Sphere{{0, 0, 2}, 0.7}, b.diffuse(0.5F));
  b.shape(test::disk({0, 0, 0}, 0.6, true), b.diffuse(0), b.area_light(5));
  auto& shapes = b.description().shapes;
  shapes[1].motion = {{{0, translated(-1, 0, 0)}, {1, translated(1, 0.3, 0)}}};
  shapes[2].motion = {
      {{0, motion::multiply(translated(1, 2, 1), motion::test::turned({1, 0, 0}, -90))},
       {1, motion::multiply(translated(-1.5, 2, 1), motion::test::turned({1, 0, 0}, -60))}}};
  b.camera({0, 0.5, -2.5}, 60);
  b.description().sensor.shutter_close = 1;
  return b.take();
}

constexpr int kGrid = 4;

enum class With { kPath, kBidirectional, kMultiplexed };

// Means by tile under a shutter.
std::vector<test::Moments> trace(const scene::SceneDescription& d,
                                 const sensor::ShutterSettings& settings, With with,
                                 uint64_t paths) {
  const FlushDenormals flush;
  const sensor::Shutter shutter(settings, kGrid);
  const Scene own(d, "avx2");
  const Scene scene(own, shutter.interval());
  const sensor::Camera camera(d.sensor, d.film, kGrid, kGrid, shutter,
                              {scene.anything_moves(), double(scene.lights().scene_radius())});
  const Float zero(0.F), size(static_cast<float>(kGrid));
  const RasterWindow raster{zero, zero, size, size};
  std::unique_ptr<Estimator> estimator;
  if (with == With::kPath) {
    estimator = std::make_unique<PathTracer>(scene, camera, PathSettings{.max_depth = 4});
  } else if (with == With::kBidirectional) {
    estimator = std::make_unique<BidirectionalTracer>(
        scene, camera, BidirectionalSettings{.max_depth = 4}, raster);
  } else {
    estimator =
        std::make_unique<MultiplexedTracer>(scene, camera, BidirectionalSettings{.max_depth = 4},
                                            raster, std::vector<double>{1, 1, 1, 1});
  }
  IndependentSource source(rng_key(5, RngDomain::kTest));
  std::vector<test::Moments> tiles(kGrid * kGrid);
  Contribution c;
  for (uint64_t i = 0; i < paths; i += kLanes) {
    source.begin(i);
    estimator->trace(source, raster, all_lanes(), c);
    for (int lane = 0; lane < kLanes; ++lane) {
      std::vector<double> found(tiles.size(), 0);
      for (const Splat& s : c.splats) {
        const double value = lane_value(luminance(s.radiance), lane);
        if (value == 0) continue;
        const int x = std::min(static_cast<int>(lane_value(s.raster_x, lane)), kGrid - 1);
        const int y = std::min(static_cast<int>(lane_value(s.raster_y, lane)), kGrid - 1);
        found[size_t(y) * kGrid + x] += value * kGrid * kGrid;
      }
      for (size_t t = 0; t < tiles.size(); ++t) tiles[t].add(found[t]);
    }
  }
  return tiles;
}

// H0: tile by tile the same mean. 16 tiles, family rate 1e-6.
void expect_same(const std::vector<test::Moments>& a, const std::vector<test::Moments>& b,
                 double factor = 1) {
  for (size_t t = 0; t < a.size(); ++t) {
    const double difference = a[t].mean() - b[t].mean() * factor;
    const double error = std::hypot(a[t].standard_error(), factor * b[t].standard_error());
    if (difference == 0) continue;  // both black
    EXPECT_GT(test::normal_p(difference / error), test::sidak(1e-6, 16))
        << t << ": " << a[t].mean() << " against " << factor * b[t].mean();
  }
}

constexpr uint64_t kPaths = 160000;

sensor::ShutterSettings open_from(double open, double close) {
  return {.open = open, .close = close};
}

TEST(Shutter, AllTechniquesSeeTheSameMotion) {
  const scene::SceneDescription d = scene_in_motion();
  const auto path = trace(d, open_from(0, 1), With::kPath, kPaths);
  expect_same(path, trace(d, open_from(0, 1), With::kBidirectional, kPaths));
  expect_same(path, trace(d, open_from(0, 1), With::kMultiplexed, 4 * kPaths));
}

TEST(Shutter, CurvesWeighTheTime) {
  const scene::SceneDescription d = scene_in_motion();
  sensor::ShutterSettings late = open_from(0, 1);
  late.curve = sensor::ShutterCurve::kTabulated;
  late.samples = {0, 0, 0, 1, 1};  // rises between 1/2 and 3/4
  const auto path = trace(d, late, With::kPath, kPaths);
  expect_same(path, trace(d, late, With::kBidirectional, kPaths));
  // Nothing of it is before 1/2: the image is that of the later half with a curve of its own.
  sensor::ShutterSettings half = open_from(0.5, 1);
  half.curve = sensor::ShutterCurve::kTrapezoid;
  half.ramp_open = 0.5;
  expect_same(path, trace(d, half, With::kPath, kPaths));
}

// A shutter open for twice as long lets in twice the light where a camera's exposure is meant.
TEST(Shutter, ExposesAsACameraDoes) {
  scene::SceneDescription d = scene_in_motion();
  for (scene::Shape& shape : d.shapes) shape.motion = {};
  d.shapes[2].geometry = test::disk({0, 2, 1}, 0.6, true);
  sensor::ShutterSettings camera = open_from(0, 0.25);
  const auto normalized = trace(d, camera, With::kPath, kPaths / 8);
  camera.exposure = sensor::Exposure::kCamera;
  const auto quarter = trace(d, camera, With::kPath, kPaths / 8);
  camera.close = 0.5;
  const auto half = trace(d, camera, With::kPath, kPaths / 8);
  for (size_t t = 0; t < quarter.size(); ++t) {
    EXPECT_NEAR(quarter[t].mean(), 0.25 * normalized[t].mean(), 1e-6 * normalized[t].mean());
    EXPECT_NEAR(half[t].mean(), 2 * quarter[t].mean(), 1e-6 * normalized[t].mean());
  }
}

// Rows have times of their own, for light subpaths too, which learn their row last.
TEST(Shutter, RollingRowsAgree) {
  const scene::SceneDescription d = scene_in_motion();
  for (double rolling : {0.6, -0.6}) {
    sensor::ShutterSettings s = rolling > 0 ? open_from(0, 0.4) : open_from(0.6, 1);
    s.rolling = rolling;
    const auto path = trace(d, s, With::kPath, kPaths);
    expect_same(path, trace(d, s, With::kBidirectional, kPaths));
    expect_same(path, trace(d, s, With::kMultiplexed, 4 * kPaths));
    // The first row sees one end of the time only, the last row the other.
    const auto all = trace(d, open_from(0, 1), With::kPath, kPaths);
    double apart = 0;
    for (size_t t = 0; t < all.size(); ++t) {
      if (all[t].mean() == 0) continue;
      apart = std::max(apart, std::fabs(all[t].mean() - path[t].mean()) /
                                  std::hypot(all[t].standard_error(), path[t].standard_error()));
    }
    EXPECT_GT(apart, 8);
  }
}

// The primary sample of a scene that stands still, or is caught in an instant, has no time.
TEST(Shutter, TimeIsDrawnOnlyWhereSomethingMoves) {
  struct Reads {
    sensor::ShutterSettings settings;
    bool moves;
    bool time;
  };
  for (const Reads& r :
       {Reads{open_from(0, 1), true, true}, Reads{open_from(0, 1), false, false},
        Reads{open_from(0.5, 0.5), true, false}, Reads{open_from(1, 2), true, false}}) {
    scene::SceneDescription d = scene_in_motion();
    if (!r.moves)
      for (scene::Shape& shape : d.shapes) shape.motion = {};
    const sensor::Shutter shutter(r.settings, kGrid);
    const Scene own(d, "avx2");
    const Scene scene(own, shutter.interval());
    const sensor::Camera camera(d.sensor, d.film, kGrid, kGrid, shutter,
                                {scene.anything_moves(), 1});
    const Float zero(0.F), size(static_cast<float>(kGrid));
    PathTracer path(scene, camera, {});
    BidirectionalTracer both(scene, camera, {}, {zero, zero, size, size});
    for (Estimator* estimator : {static_cast<Estimator*>(&path), static_cast<Estimator*>(&both)}) {
      IndependentSource source(rng_key(5, RngDomain::kTest));
      source.begin(0);
      Contribution c;
      estimator->trace(source, {zero, zero, size, size}, all_lanes(), c);
      bool read = false;
      for (const primary_space::StoredPair& pair : source.read_pairs(3))
        read = read || pair.slot == primary_space::kTimeSlot;
      EXPECT_EQ(read, r.time);
    }
  }
}

}  // namespace
}  // namespace metrofarm::transport
