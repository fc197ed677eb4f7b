// A scene looks alike whatever unit its lengths are in.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/room.h"
#include "tests/support/trace.h"

namespace metrofarm::transport {
namespace {

using test::Traced;

class ScaleTest : public testing::TestWithParam<double> {};

// H0: every tile has the mean that it has at scale 1. Welch tests of 16 tiles, 10,000 paths each,
// family rate 1e-5.
TEST_P(ScaleTest, TheRoomLooksAlike) {
  PathSettings settings;
  settings.max_depth = 8;
  scene::SceneDescription scaled = test::room();
  test::scale(scaled, GetParam());
  const Traced reference = test::trace_paths(test::room(), settings, 160000, 51, 4);
  const Traced other = test::trace_paths(std::move(scaled), settings, 160000, 52, 4);
  for (size_t t = 0; t < reference.tiles.size(); ++t)
    EXPECT_TRUE(test::same_mean(reference.tiles[t], other.tiles[t], test::sidak(1e-5, 16)))
        << "tile " << t;
  for (uint64_t n : other.anomalies) EXPECT_EQ(n, 0U);
}

// The same random numbers give nearly the same mean: what rounding decides otherwise is little.
TEST_P(ScaleTest, TheSamePathsGiveTheSameMean) {
  scene::SceneDescription scaled = test::room();
  test::scale(scaled, GetParam());
  const Traced reference = test::trace_paths(test::room(), {}, 80000, 53);
  const Traced other = test::trace_paths(std::move(scaled), {}, 80000, 53);
  EXPECT_NEAR(other.all.mean() / reference.all.mean(), 1, 5e-3);
}

INSTANTIATE_TEST_SUITE_P(Scales, ScaleTest, testing::Values(1e-4, 1e6));

}  // namespace
}  // namespace metrofarm::transport
