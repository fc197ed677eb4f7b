#include "math/vec.h"

#include <gtest/gtest.h>

#include "tests/support/lane_tools.h"

namespace metrofarm {
namespace {

using test::lanes_of;

void expect_orthonormal(const Frame& f, const Vec3& n) {
  const Vec3 turn = cross(f.s, f.t) - f.n;
  for (Float error : {dot(f.s, f.t), dot(f.s, f.n), dot(f.t, f.n), dot(f.s, f.s) - Float(1.F),
                      dot(f.t, f.t) - Float(1.F), turn.x, turn.y, turn.z, f.n.x - n.x, f.n.y - n.y,
                      f.n.z - n.z}) {
    for (float e : lanes_of(error)) EXPECT_NEAR(e, 0, 2e-6);
  }
}

TEST(Frame, IsOrthonormalAndRightHandedAroundRandomNormals) {
  test::UniformLanes random(11);
  for (int i = 0; i < 5000; ++i) {
    const Vec3 n = random.direction();
    expect_orthonormal(frame_around(n), n);
  }
}

TEST(Frame, IsOrthonormalAroundThePolesAndAxes) {
  for (float z : {1.F, -1.F, -0.99999994F, 0.99999994F}) {
    const float x = std::sqrt(std::max(0.F, 1 - z * z));
    const Vec3 n = splat(x, 0, z);
    expect_orthonormal(frame_around(n), n);
  }
  expect_orthonormal(frame_around(splat(1, 0, 0)), splat(1, 0, 0));
  expect_orthonormal(frame_around(splat(0, -1, -0.F)), splat(0, -1, 0));
}

TEST(Frame, ToLocalUndoesToWorld) {
  test::UniformLanes random(12);
  for (int i = 0; i < 1000; ++i) {
    const Frame frame = frame_around(random.direction());
    const Vec3 v = random.direction();
    const Vec3 error = frame.to_local(frame.to_world(v)) - v;
    for (float e : lanes_of(max_component(abs(error)))) EXPECT_LT(e, 1e-6);
  }
}

TEST(Vec3, Gather3ReadsThreeNeighbours) {
  // With the spare element that wide loads may touch.
  const float table[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 0};
  const Int index = _mm256_setr_epi32(2, 0, 1, 2, 0, 1, 2, 99);
  const Vec3 v = gather3(table, index, first_lanes(7));
  EXPECT_EQ(lanes_of(v.x), (test::Lanes{6, 0, 3, 6, 0, 3, 6, 0}));
  EXPECT_EQ(lanes_of(v.z), (test::Lanes{8, 2, 5, 8, 2, 5, 8, 0}));
}

TEST(Vec3, CrossIsRightHanded) {
  const Vec3 z = cross(splat(1, 0, 0), splat(0, 1, 0));
  EXPECT_EQ(lane_value(z.z, 0), 1.F);
  EXPECT_EQ(lane_value(max_component(abs(z)), 0), 1.F);
}

}  // namespace
}  // namespace metrofarm
