#include "geometry/surface.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/geometry/world.h"

namespace metrofarm::geometry {
namespace {

using test::Double3;
using test::lane_of;

TEST(Surface, FaceNormalsFollowTheWindingAndTheFlip) {
  for (bool flip : {false, true}) {
    test::SceneBuilder b;
    b.shape(test::quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}), b.diffuse(0.5F), scene::kNone, flip);
    const World world(b);
    for (double side : {-3.0, 3.0}) {
      const Surface s = world.look({0.3, 0.2, side}, {0, 0, -side});
      const double sign = flip ? -1 : 1;
      expect_near(lane_of(s.geometric_normal, 0), {0, 0, sign}, 1e-6);
      expect_near(lane_of(s.shading_normal, 0), {0, 0, sign}, 1e-6);
      expect_near(lane_of(s.position, 0), {0.3, 0.2, 0}, 1e-6);
    }
  }
}

TEST(Surface, SmoothNormalsAreInterpolatedAndNormalized) {
  for (bool flip : {false, true}) {
    test::SceneBuilder b;
    b.shape(smooth_triangle(), b.diffuse(0.5F), scene::kNone, flip);
    const World world(b);
    const Surface s = world.look({0.25, 0.5, 2}, {0, 0, -1});
    const double sign = flip ? -1 : 1;
    const Double3 expected = normalize(Double3{0.25 * 0.6, 0.5 * 0.6, 0.25 + 0.75 * 0.8});
    expect_near(lane_of(s.shading_normal, 0), expected * sign, 1e-6);
    expect_near(lane_of(s.geometric_normal, 0), {0, 0, sign}, 1e-6);
  }
}

TEST(Surface, TheTangentFollowsTheTextureCoordinates) {
  test::SceneBuilder b;
  b.shape(smooth_triangle(), b.diffuse(0.5F));
  const Surface s = World(b).look({0.25, 0.5, 2}, {0, 0, -1});
  expect_near(normalize(lane_of(s.dp_du, 0)), {0, 1, 0}, 1e-6);
}

TEST(Surface, MeshesWithAndWithoutNormalsLiveTogether) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(test::quad({5, -1, 0}, {2, 0, 0}, {0, 2, 0}), grey).shape(smooth_triangle(), grey);
  const World world(b);
  expect_near(lane_of(world.look({6, 0.1, 2}, {0, 0, -1}).shading_normal, 0), {0, 0, 1}, 1e-6);
  EXPECT_LT(lane_of(world.look({0.4, 0.4, 2}, {0, 0, -1}).shading_normal, 0).z, 0.95);
}

TEST(Surface, VertexNormalsOfNoLengthShadeFlat) {
  test::SceneBuilder b;
  scene::TriangleMesh mesh = smooth_triangle();
  mesh.normals.assign(9, 0.F);
  b.shape(mesh, b.diffuse(0.5F));
  const Surface s = World(b).look({0.25, 0.25, 2}, {0, 0, -1});
  expect_near(lane_of(s.shading_normal, 0), {0, 0, 1}, 1e-6);
}

TEST(Surface, SpheresHaveRadialNormalsAndPointsOnThem) {
  for (bool flip : {false, true}) {
    test::SceneBuilder b;
    b.shape(scene::Sphere{{1, 2, 3}, 2}, b.diffuse(0.5F), scene::kNone, flip);
    const World world(b);
    test::UniformLanes random(1);
    for (int i = 0; i < 200; ++i) {
      const Double3 d = lane_of(random.direction(), 0);
      const Surface s = world.look({1.1, 2.2, 2.9}, d);
      const Double3 radial = lane_of(s.position, 0) - Double3{1, 2, 3};
      EXPECT_NEAR(length(radial), 2, 1e-6);
      expect_near(lane_of(s.geometric_normal, 0), radial * (flip ? -0.5 : 0.5), 1e-6);
      EXPECT_NEAR(dot(lane_of(s.dp_du, 0), radial), 0, 2e-5);
    }
  }
}

TEST(Surface, DisksHaveTheNormalOfTheirTransform) {
  test::SceneBuilder b;
  b.shape(scene::Disk{{0, 0, 1, 4, 2, 0, 0, 5, 0, 3, 0, 6, 0, 0, 0, 1}}, b.diffuse(0.5F));
  const Surface s = World(b).look({9, 5.5, 6.5}, {-1, 0, 0});
  expect_near(lane_of(s.geometric_normal, 0), {1, 0, 0}, 1e-6);
  expect_near(lane_of(s.position, 0), {4, 5.5, 6.5}, 1e-5);
}

TEST(Surface, MirroredDisksKeepTheNormalOfTheirTransform) {
  test::SceneBuilder b;
  b.shape(scene::Disk{{-2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}, b.diffuse(0.5F));
  const Surface s = World(b).look({0.3, 0.4, 3}, {0, 0, -1});
  expect_near(lane_of(s.geometric_normal, 0), {0, 0, 1}, 1e-6);
}

TEST(Surface, CylindersHaveNormalsAwayFromTheirAxis) {
  for (bool flip : {false, true}) {
    test::SceneBuilder b;
    b.shape(scene::Cylinder{{0, 0, 4, 1, 2, 0, 0, 2, 0, 2, 0, 3, 0, 0, 0, 1}}, b.diffuse(0.5F),
            scene::kNone, flip);
    const World world(b);
    test::UniformLanes random(1);
    for (int i = 0; i < 200; ++i) {
      Double3 d = lane_of(random.direction(), 0);
      d.x *= 0.3;
      if (std::hypot(d.y, d.z) < 0.5) continue;  // leaves through an end
      const Surface s = world.look({3.1, 2.2, 2.9}, d);
      Double3 radial = lane_of(s.position, 0) - Double3{0, 2, 3};
      radial.x = 0;
      EXPECT_NEAR(length(radial), 2, 1e-6);
      expect_near(lane_of(s.geometric_normal, 0), radial * (flip ? -0.5 : 0.5), 1e-6);
    }
  }
}

// Uniform by area: a point's height and azimuth are its surface coordinates.
TEST(Surface, PointOnCylinderIsTheHitAtItsCoordinates) {
  test::SceneBuilder b;
  b.shape(scene::Cylinder{{0, 0, 4, 1, 2, 0, 0, 2, 0, 2, 0, 3, 0, 0, 0, 1}}, b.diffuse(0.5F));
  const World world(b);
  test::UniformLanes random(2);
  const Vec2 uv = random.pair();
  const TrianglePoint p = point_on_cylinder(world.primitives, Int(0), uv, all_lanes());
  for (int lane = 0; lane < kLanes; ++lane) {
    const Double3 n = lane_of(p.normal, lane);
    const Surface s = world.look(lane_of(p.position, lane) + n, n * -1);
    expect_near(lane_of(s.position, 0), lane_of(p.position, lane), 2e-6);
    expect_near(lane_of(s.geometric_normal, 0), n, 1e-6);
    EXPECT_NEAR(lane_value(s.point.uv.x, 0), lane_value(uv.x, lane), 1e-6);
    EXPECT_NEAR(lane_value(s.point.uv.y, 0), lane_value(uv.y, lane), 1e-6);
    EXPECT_EQ(lane_value(s.offset, 0), lane_value(p.offset, lane));
  }
}

TEST(Surface, PointOnTriangleIsTheHitAtItsBarycentrics) {
  test::SceneBuilder b;
  b.shape(smooth_triangle(), b.diffuse(0.5F));
  const World world(b);
  const TrianglePoint p = point_on_triangle(world.primitives, world.placements, Int(0),
                                            {Float(0.25F), Float(0.5F)}, Float(0.F), all_lanes());
  expect_near(lane_of(p.position, 0), {0.25, 0.5, 0}, 1e-7);
  expect_near(lane_of(p.normal, 0), {0, 0, 1}, 1e-7);
}

}  // namespace
}  // namespace metrofarm::geometry
