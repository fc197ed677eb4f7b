#include "geometry/surface.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/lane_tools.h"
#include "tests/support/scenes.h"

namespace metrofarm::geometry {
namespace {

using test::Double3;
using test::lane_of;

struct World {
  explicit World(test::SceneBuilder& builder)
      : scene(builder.take()), primitives(build_primitives(scene)), tracer(primitives, "avx2") {}

  // The surface that a ray meets. Requires: it meets one.
  Surface look(Double3 from, Double3 direction) const {
    const Vec3 o = test::splat(from), d = test::splat(normalize(direction));
    const RayHits hits = tracer.intersect(all_lanes(), o, d);
    EXPECT_TRUE(all(hits.hit));
    return surface_at(primitives, hits, o, d, true);
  }

  scene::SceneDescription scene;
  Primitives primitives;
  Tracer tracer;
};

void expect_near(Double3 a, Double3 b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

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

scene::TriangleMesh smooth_triangle() {
  scene::TriangleMesh mesh;
  mesh.positions = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  mesh.normals = {0, 0, 1, 0.6F, 0, 0.8F, 0, 0.6F, 0.8F};
  mesh.texcoords = {0, 0, 0, 2, 1, 0};
  mesh.indices = {0, 1, 2};
  return mesh;
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
  expect_near(normalize(lane_of(s.tangent, 0)), {0, 1, 0}, 1e-6);
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
      EXPECT_NEAR(dot(lane_of(s.tangent, 0), radial), 0, 1e-6);
    }
  }
}

TEST(Surface, DisksHaveTheNormalOfTheirTransform) {
  test::SceneBuilder b;
  b.shape(scene::Disk{{0, 0, 1, 4, 2, 0, 0, 5, 0, 3, 0, 6, 0, 0, 0, 1}}, b.diffuse(0.5F));
  const Surface s = World(b).look({9, 5.5, 6.5}, {-1, 0, 0});
  expect_near(lane_of(s.geometric_normal, 0), {1, 0, 0}, 1e-6);
  expect_near(lane_of(s.position, 0), {4, 5.5, 6.5}, 1e-5);
  expect_near(normalize(lane_of(s.tangent, 0)), {0, 1, 0}, 1e-6);
}

TEST(Surface, PointOnTriangleIsTheHitAtItsBarycentrics) {
  test::SceneBuilder b;
  b.shape(smooth_triangle(), b.diffuse(0.5F));
  const World world(b);
  const TrianglePoint p =
      point_on_triangle(world.primitives, Int(0), Float(0.25F), Float(0.5F), all_lanes());
  expect_near(lane_of(p.position, 0), {0.25, 0.5, 0}, 1e-7);
  expect_near(lane_of(p.normal, 0), {0, 0, 1}, 1e-7);
}

}  // namespace
}  // namespace metrofarm::geometry
