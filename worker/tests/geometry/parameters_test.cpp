// Surface coordinates and their derivatives: against Mitsuba and against finite differences.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/geometry/mitsuba_surfaces.h"
#include "tests/geometry/world.h"

namespace metrofarm::geometry {
namespace {

using test::Double3;
using test::lane_of;

Double3 vector_of(const double v[3]) {
  return {v[0], v[1], v[2]};
}

// The mesh of mitsuba_surfaces.py.
scene::TriangleMesh mesh_of(Kind kind) {
  scene::TriangleMesh mesh;
  mesh.positions = {-1, -0.8F, 0.1F, 1.2F, -1, 0.3F, -0.2F, 1.1F, -0.4F};
  mesh.indices = {0, 1, 2};
  if (kind == Kind::kSmoothMesh) {
    mesh.normals = {0, 0, 1, 0.6F, 0, 0.8F, 0, 0.6F, 0.8F};
    mesh.texcoords = {0.1F, 0.2F, 0.3F, 2, 1, -0.5F};
  }
  if (kind == Kind::kDegenerateMesh) mesh.texcoords.assign(6, 0.5F);
  return mesh;
}

using Geometry = decltype(scene::Shape::geometry);

Geometry geometry_of(Kind kind, const scene::Matrix& m) {
  switch (kind) {
    case Kind::kSphere: {
      const double radius = std::hypot(m[0], m[4], m[8]);
      scene::Sphere sphere{{m[3], m[7], m[11]}, radius};
      for (int i = 0; i < 9; ++i) sphere.rotation[i] = m[4 * (i / 3) + i % 3] / radius;
      return sphere;
    }
    case Kind::kDisk:
      return scene::Disk{m};
    case Kind::kCylinder:
      return scene::Cylinder{m};
    default:
      return mesh_of(kind);
  }
}

scene::SceneDescription scene_of(const MitsubaHit& hit) {
  scene::Matrix matrix = {};
  std::copy_n(hit.to_world, 12, matrix.begin());
  matrix[15] = 1;
  test::SceneBuilder b;
  const scene::Matrix in_group = hit.instanced ? scene::Matrix(scene::Disk{}.to_world) : matrix;
  b.shape(geometry_of(hit.kind, in_group), b.diffuse(0.5F), scene::kNone, hit.flip_normals);
  if (hit.instanced) {
    b.description().shapes[0].group = 0;
    b.description().instances.push_back({matrix, 0, {}});
  }
  return b.take();
}

// Tolerances: Mitsuba computes in float too, and the derivatives are up to about 20.
TEST(Parameters, AgreeWithMitsuba) {
  for (const MitsubaHit& hit : kMitsubaHits) {
    SCOPED_TRACE("hit " + std::to_string(&hit - kMitsubaHits));
    const World world(scene_of(hit));
    const Surface s = world.look(vector_of(hit.origin), vector_of(hit.direction));
    expect_near(lane_of(s.position, 0), vector_of(hit.position), 2e-5);
    expect_near(lane_of(s.geometric_normal, 0), vector_of(hit.geometric_normal), 2e-5);
    expect_near(lane_of(s.shading_normal, 0), vector_of(hit.shading_normal), 2e-5);
    EXPECT_NEAR(lane_value(s.point.uv.x, 0), hit.uv[0], 1e-5);
    EXPECT_NEAR(lane_value(s.point.uv.y, 0), hit.uv[1], 1e-5);
    expect_near(lane_of(s.dp_du, 0), vector_of(hit.dp_du), 3e-4);
    expect_near(lane_of(s.dp_dv, 0), vector_of(hit.dp_dv), 3e-4);
  }
}

// Two hits close together on one shape: the step between them is dp_du du + dp_dv dv.
TEST(Parameters, DerivativesPredictTheStepToAPointNearby) {
  int compared = 0;
  for (const MitsubaHit& hit : kMitsubaHits) {
    if (hit.kind == Kind::kDegenerateMesh) continue;
    SCOPED_TRACE("hit " + std::to_string(&hit - kMitsubaHits));
    const World world(scene_of(hit));
    const Double3 o = vector_of(hit.origin), d = vector_of(hit.direction);
    const Surface s = world.look(o, d);
    const Surface t = world.look(o, d + Double3{2e-4, -3e-4, 1e-4});
    const double du = double(lane_value(t.point.uv.x, 0)) - lane_value(s.point.uv.x, 0);
    const double dv = double(lane_value(t.point.uv.y, 0)) - lane_value(s.point.uv.y, 0);
    if (std::fabs(du) > 0.5) continue;  // across the seam
    const Double3 step = lane_of(t.position, 0) - lane_of(s.position, 0);
    const Double3 predicted = lane_of(s.dp_du, 0) * du + lane_of(s.dp_dv, 0) * dv;
    EXPECT_LT(length(step - predicted), 0.02 * length(step) + 1e-5);
    ++compared;
  }
  EXPECT_GT(compared, 50);
}

TEST(Parameters, PolesOfSpheresHaveAFrame) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 2}, b.diffuse(0.5F));
  const World world(b);
  const Surface north = world.look({0, 0, 5}, {0, 0, -1}),
                south = world.look({0, 0, -5}, {0, 0, 1});
  const double turn = 2 * std::numbers::pi;
  expect_near(lane_of(north.dp_dv, 0), {turn, 0, 0}, 1e-5);
  expect_near(lane_of(south.dp_dv, 0), {turn, 0, 0}, 1e-5);
  EXPECT_NEAR(lane_value(north.point.uv.y, 0), 0, 1e-6);
  EXPECT_NEAR(lane_value(south.point.uv.y, 0), 1, 1e-6);
}

TEST(Parameters, MeshesWithAndWithoutTexcoordsLiveTogether) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(test::quad({5, -1, 0}, {2, 0, 0}, {0, 2, 0}), grey).shape(smooth_triangle(), grey);
  const World world(b);
  const Surface plain = world.look({6.5, -0.5, 2}, {0, 0, -1});
  EXPECT_NEAR(lane_value(plain.point.uv.x, 0), 0.5, 1e-6);
  EXPECT_NEAR(lane_value(plain.point.uv.y, 0), 0.25, 1e-6);
  expect_near(lane_of(plain.dp_du, 0), {2, 0, 0}, 1e-6);
  const Surface own = world.look({0.25, 0.5, 2}, {0, 0, -1});
  EXPECT_NEAR(lane_value(own.point.uv.x, 0), 0.5, 1e-6);
  EXPECT_NEAR(lane_value(own.point.uv.y, 0), 0.5, 1e-6);
  EXPECT_EQ(lane_word(as_uint(own.point.primitive), 0), 2U);
  EXPECT_NEAR(lane_value(own.point.b1, 0), 0.25, 1e-6);
  EXPECT_NEAR(lane_value(own.point.b2, 0), 0.5, 1e-6);
}

// Lanes on different triangles and shapes do not disturb each other.
TEST(Parameters, AreTheSameForMixedLanes) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(smooth_triangle(), grey)
      .shape(test::quad({5, -1, 0}, {2, 0, 0}, {0, 2, 0}), grey)
      .shape(scene::Sphere{{10, 0, 0}, 1}, grey)
      .shape(test::disk({15, 0, 0}, 1), grey)
      .shape(scene::Cylinder{{0.5, 0, 0, 20, 0, 0, 1, 0, 0, -0.5, 0, 0, 0, 0, 0, 1}}, grey);
  const World world(b);
  alignas(32) float x[kLanes] = {0.25F, 6, 10.5F, 15.25F, 20, 0.5F, 5.5F, 40};
  const Vec3 origin{Float::load_aligned(x), Float(0.25F), Float(3.F)};
  const Vec3 direction = normalize(splat(0, -0.03F, -1));
  const RayHits hits = world.tracer.intersect(all_lanes(), origin, direction);
  EXPECT_EQ(bits(hits.hit), 0x7fU);
  const Surface mixed =
      surface_at(world.primitives, world.placements, hits, origin, direction, {true, true});
  for (int lane = 0; lane < 7; ++lane) {
    const Surface s = world.look(lane_of(origin, lane), {0, -0.03, -1});
    expect_near(lane_of(mixed.position, lane), lane_of(s.position, 0), 1e-5);
    expect_near(lane_of(mixed.dp_du, lane), lane_of(s.dp_du, 0), 1e-4);
    expect_near(lane_of(mixed.dp_dv, lane), lane_of(s.dp_dv, 0), 1e-4);
    EXPECT_NEAR(lane_value(mixed.point.uv.x, lane), lane_value(s.point.uv.x, 0), 1e-5);
    EXPECT_NEAR(lane_value(mixed.point.uv.y, lane), lane_value(s.point.uv.y, 0), 1e-5);
  }
}

}  // namespace
}  // namespace metrofarm::geometry
