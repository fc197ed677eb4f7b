// Paths shorter than min_depth bring nothing back, and nothing else changes: a primary sample's
// light is the sum of what its short and its long paths carry.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "base/parallel.h"
#include "tests/support/lane_tools.h"
#include "tests/support/room.h"
#include "transport/multiplexed.h"
#include "transport/path_tracer.h"

namespace metrofarm::transport {
namespace {

constexpr int kPacks = 2000;

class MinDepth : public testing::Test {
 protected:
  MinDepth()
      : scene_(test::room(), "avx2"),
        camera_(scene_.description().sensor, scene_.description().film, 1, 1) {}

  // Luminance of the samples of pack i.
  std::array<float, kLanes> traced(Estimator& estimator, int i) {
    primary_space::IndependentSource source(rng_key(7, RngDomain::kTest));
    source.begin(uint64_t(i) * kLanes);
    Contribution c;
    estimator.trace(source, raster_, all_lanes(), c);
    return test::lanes_of(luminance(c.total()));
  }

  void expect_sum(Estimator& whole, Estimator& brief, Estimator& rest) {
    int both = 0;
    for (int i = 0; i < kPacks; ++i) {
      const auto all = traced(whole, i), direct = traced(brief, i), indirect = traced(rest, i);
      for (int lane = 0; lane < kLanes; ++lane) {
        ASSERT_NEAR(direct[lane] + indirect[lane], all[lane], 1e-5 * all[lane]);
        both += direct[lane] > 0 && indirect[lane] > 0;
      }
    }
    EXPECT_GT(both, kPacks);  // of kLanes times as many samples
    EXPECT_LT(rest.costs().rays, whole.costs().rays);
  }

  FlushDenormals flush_;
  Scene scene_;
  sensor::Camera camera_;
  RasterWindow raster_{Float(0.F), Float(0.F), Float(1.F), Float(1.F)};
};

TEST_F(MinDepth, SplitsPathTracing) {
  for (LightSampling sampling : {LightSampling::kMis, LightSampling::kEmitter}) {
    const auto make = [&](int min_depth, int max_depth) {
      PathSettings s{.light_sampling = sampling, .max_depth = max_depth, .rr_depth = 2};
      s.min_depth = min_depth;
      return PathTracer(scene_, camera_, s);
    };
    PathTracer whole = make(1, 6), brief = make(1, 2), rest = make(3, 6);
    expect_sum(whole, brief, rest);
  }
}

TEST_F(MinDepth, SplitsBidirectionalTracing) {
  const auto make = [&](int min_depth, int max_depth) {
    const BidirectionalSettings s{.max_depth = max_depth, .rr_depth = 2, .min_depth = min_depth};
    return BidirectionalTracer(scene_, camera_, s, raster_);
  };
  BidirectionalTracer whole = make(1, 5), brief = make(1, 2), rest = make(3, 5);
  expect_sum(whole, brief, rest);
}

TEST_F(MinDepth, LeavesShortMultiplexedPathsOut) {
  const auto make = [&](int min_depth) {
    const BidirectionalSettings s{.max_depth = 5, .rr_depth = 2, .min_depth = min_depth};
    return MultiplexedTracer(scene_, camera_, s, raster_, {1, 1, 1, 1, 1});
  };
  MultiplexedTracer whole = make(1), rest = make(3);
  int left_out = 0, kept = 0;
  for (int i = 0; i < kPacks; ++i) {
    primary_space::IndependentSource source(rng_key(7, RngDomain::kTest));
    source.begin(uint64_t(i) * kLanes);
    const auto u = test::lanes_of(source.pair(primary_space::kTechniqueSlot, all_lanes()).first);
    const auto all = traced(whole, i), indirect = traced(rest, i);
    for (int lane = 0; lane < kLanes; ++lane) {
      const bool brief = u[lane] < 0.399F, known = brief || u[lane] > 0.401F;
      if (!known) continue;
      ASSERT_EQ(indirect[lane], brief ? 0.F : all[lane]);
      left_out += brief && all[lane] > 0;
      kept += !brief && all[lane] > 0;
    }
  }
  EXPECT_GT(left_out, kPacks / 2);
  EXPECT_GT(kept, kPacks / 2);
}

}  // namespace
}  // namespace metrofarm::transport
