// Groups seen through instances: hits equal those of the same shapes transformed beforehand.
#include <gtest/gtest.h>

#include <cmath>
#include <new>
#include <random>

#include "tests/geometry/world.h"
#include "tests/motion/motions.h"

namespace metrofarm::geometry {
namespace {

using scene::Matrix;
using test::Double3;
using test::lane_of;

const Matrix kRotated = {0.36, -0.8, -0.48, 3, 0.48, 0.6, -0.64, -1, 0.8, 0, 0.6, 2, 0, 0, 0, 1};
const Matrix kMirrored = {-1, 0, 0, 0.5, 0, 1, 0, 0.2, 0, 0, 1, -0.3, 0, 0, 0, 1};

// a times b.
Matrix product(const Matrix& a, const Matrix& b) {
  Matrix out = {};
  for (int i = 0; i < 16; ++i) {
    for (int k = 0; k < 4; ++k) out[i] += a[4 * (i / 4) + k] * b[4 * k + i % 4];
  }
  return out;
}

Matrix scaled(double x, double y, double z) {
  return {x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1};
}

Double3 apply(const Matrix& m, const float* p, double w) {
  return {m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + w * m[3],
          m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + w * m[7],
          m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + w * m[11]};
}

// n under the inverse transpose, from the images of two directions across it. The result is not
// unit: vertex normals must weigh as they do before the transform.
Double3 apply_to_normal(const Matrix& m, const float* n) {
  const Frame f = frame_around(splat(n[0], n[1], n[2]));
  const auto image = [&](const Vec3& v) {
    const Double3 d = lane_of(v, 0);
    const float p[3] = {float(d.x), float(d.y), float(d.z)};
    return apply(m, p, 0);
  };
  const Double3 normal = cross(image(f.s), image(f.t));
  return dot(normal, apply(m, n, 0)) < 0 ? normal * -1 : normal;
}

void store(Double3 v, float* out) {
  out[0] = static_cast<float>(v.x);
  out[1] = static_cast<float>(v.y);
  out[2] = static_cast<float>(v.z);
}

// The mesh as it lies in the world: a mirror turns the winding, which turns it back.
scene::TriangleMesh transformed(scene::TriangleMesh mesh, const Matrix& m, bool mirror) {
  for (size_t i = 0; i < mesh.positions.size(); i += 3) {
    store(apply(m, &mesh.positions[i], 1), &mesh.positions[i]);
    store(apply_to_normal(m, &mesh.normals[i]), &mesh.normals[i]);
  }
  if (!mirror) return mesh;
  for (size_t i = 0; i < mesh.indices.size(); i += 3)
    std::swap(mesh.indices[i + 1], mesh.indices[i + 2]);
  return mesh;
}

// Bumpy random triangles with normals and texture coordinates.
scene::TriangleMesh random_mesh(int triangles, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<float> uniform(-1, 1);
  scene::TriangleMesh mesh;
  for (int i = 0; i < triangles; ++i) {
    const float at[3] = {uniform(random), uniform(random), uniform(random)};
    for (uint32_t k = 0; k < 3; ++k) {
      for (float c : at) mesh.positions.push_back(c + 0.3F * uniform(random));
      const Double3 n = normalize(Double3{uniform(random), uniform(random), 2 + uniform(random)});
      mesh.normals.resize(mesh.normals.size() + 3);
      store(n, &mesh.normals[mesh.normals.size() - 3]);
      for (int c = 0; c < 2; ++c) mesh.texcoords.push_back(uniform(random));
      mesh.indices.push_back(static_cast<uint32_t>(3 * i) + k);
    }
  }
  return mesh;
}

struct Placement {
  Matrix matrix;
  bool mirror;
};

class InstanceTest : public testing::TestWithParam<Placement> {};

void expect_equal_surfaces(const Surface& a, const Surface& b, int lane, double scale) {
  expect_near(lane_of(a.position, lane), lane_of(b.position, lane), 1e-5 * scale);
  expect_near(lane_of(a.geometric_normal, lane), lane_of(b.geometric_normal, lane), 2e-4);
  expect_near(lane_of(a.shading_normal, lane), lane_of(b.shading_normal, lane), 2e-4);
  EXPECT_NEAR(lane_value(a.point.uv.x, lane), lane_value(b.point.uv.x, lane), 2e-4);
  EXPECT_NEAR(lane_value(a.point.uv.y, lane), lane_value(b.point.uv.y, lane), 2e-4);
  const double stretch = length(lane_of(b.dp_du, lane)) + length(lane_of(b.dp_dv, lane));
  expect_near(lane_of(a.dp_du, lane), lane_of(b.dp_du, lane), 1e-3 * stretch);
  expect_near(lane_of(a.dp_dv, lane), lane_of(b.dp_dv, lane), 1e-3 * stretch);
}

TEST_P(InstanceTest, HitsAreThoseOfTheTransformedMesh) {
  const auto& [matrix, mirror] = GetParam();
  const scene::TriangleMesh mesh = random_mesh(60, 4);
  test::SceneBuilder inside, outside;
  inside.shape(mesh, inside.diffuse(0.5F));
  inside.description().shapes[0].group = 0;
  inside.description().instances.push_back({matrix, 0, {}});
  outside.shape(transformed(mesh, matrix, mirror), outside.diffuse(0.5F));
  const World instanced(inside), plain(outside);
  test::UniformLanes random(9);
  const Vec3 center{Float(float(matrix[3])), Float(float(matrix[7])), Float(float(matrix[11]))};
  int compared = 0;
  for (int i = 0; i < 400; ++i) {
    const Vec3 origin = center + random.direction() * Float(6.F);
    const Vec3 direction = normalize(center + random.direction() * Float(0.8F) - origin);
    const RayHits a = instanced.tracer.intersect(all_lanes(), origin, direction);
    const RayHits b = plain.tracer.intersect(all_lanes(), origin, direction);
    const Mask occluded = instanced.tracer.occluded(all_lanes(), origin, direction, Float(1e30F));
    EXPECT_EQ(bits(occluded), bits(a.hit));
    const Surface sa =
        surface_at(instanced.primitives, instanced.placements, a, origin, direction, {true, true});
    const Surface sb =
        surface_at(plain.primitives, plain.placements, b, origin, direction, {true, true});
    for (int lane = 0; lane < kLanes; ++lane) {
      // Rays along edges and grazing ones may be decided by rounding.
      if (!test::lane_set(a.hit & b.hit, lane)) continue;
      if (lane_word(as_uint(a.primitive), lane) != lane_word(as_uint(b.primitive), lane)) continue;
      const double cosine = dot(lane_of(sb.geometric_normal, lane), lane_of(direction, lane));
      if (std::fabs(cosine) < 0.1) continue;
      EXPECT_EQ(lane_word(as_uint(a.instance), lane), 0U);
      EXPECT_EQ(lane_word(as_uint(b.instance), lane), ~0U);
      expect_equal_surfaces(sa, sb, lane, 5);
      ++compared;
    }
    EXPECT_LE(__builtin_popcount(bits(a.hit) ^ bits(b.hit)), 1);
  }
  EXPECT_GT(compared, 300);
}

// A ray that leaves an instanced surface doesn't meet it again, also where the group lies far from
// its own origin and the instance brings it back.
TEST_P(InstanceTest, SurfacesAreNotMetAgain) {
  for (double far : {0.0, 500.0}) {
    const Matrix away = {1, 0, 0, far, 0, 1, 0, -far, 0, 0, 1, far, 0, 0, 0, 1};
    const Matrix back = {1, 0, 0, -far, 0, 1, 0, far, 0, 0, 1, -far, 0, 0, 0, 1};
    for (int shape = 0; shape < 20; ++shape) {
      test::SceneBuilder b;
      const scene::Index grey = b.diffuse(0.5F);
      if (shape % 2 == 0) {
        b.shape(transformed(random_mesh(1, shape), away, false), grey);
      } else {
        b.shape(scene::Disk{product(away, kRotated)}, grey);
      }
      const Matrix& m = GetParam().matrix;
      b.description().shapes[0].group = 0;
      b.description().instances.push_back({product(m, back), 0, {}});
      const World world(b);
      const Bounds box = bounds_of(world.primitives, world.placements);
      test::UniformLanes random(shape);
      const Vec3 center =
          splat(0.5F * (box.lower[0] + box.upper[0]), 0.5F * (box.lower[1] + box.upper[1]),
                0.5F * (box.lower[2] + box.upper[2]));
      for (int i = 0; i < 20; ++i) {
        const Vec3 origin = center + random.direction() * Float(5.F);
        const Vec3 direction = normalize(center + random.direction() * Float(0.4F) - origin);
        const RayHits hits = world.tracer.intersect(all_lanes(), origin, direction);
        const Surface s =
            surface_at(world.primitives, world.placements, hits, origin, direction, {});
        const Vec3 out = random.direction();
        const Vec3 start = offset_origin(s.position, s.geometric_normal, s.offset, out);
        EXPECT_TRUE(none(world.tracer.intersect(hits.hit, start, out).hit)) << far;
        for (int lane = 0; lane < kLanes; ++lane) {
          if (!test::lane_set(hits.hit, lane)) continue;
          EXPECT_LT(lane_value(s.offset, lane), 1e-3 * (1 + far));
        }
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Placements, InstanceTest,
                         testing::Values(Placement{scaled(1, 1, 1), false},
                                         Placement{kRotated, false}, Placement{kMirrored, true},
                                         Placement{product(kRotated, scaled(2, 0.5, 1.2)), false},
                                         Placement{product(product(kRotated, scaled(1, 0.4, 1.5)),
                                                           product(kMirrored, kRotated)),
                                                   true}));

// Two groups of meshes and analytic shapes, shapes outside, five instances: every hit tells which
// shape of which instance it is.
TEST(Instances, GroupsOfSeveralKindsAreToldApart) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  const auto in_group = [&](scene::Index group) { b.description().shapes.back().group = group; };
  b.shape(scene::Sphere{{0, 0, 0}, 0.4}, grey), in_group(1);
  b.shape(test::quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}), grey), in_group(0);
  b.shape(test::quad({-1, -1, -9}, {2, 0, 0}, {0, 2, 0}), grey);
  b.shape(test::disk({0, 0, 0}, 0.5), grey), in_group(0);
  b.shape(scene::Sphere{{0, 0, -5}, 0.5}, grey);
  b.shape(test::quad({-1, -1, -0.5}, {2, 0, 0}, {0, 2, 0}), grey), in_group(1);
  const auto place = [&](double x, scene::Index group) {
    b.description().instances.push_back(
        {{1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, group, {}});
  };
  place(10, 1), place(20, 0), place(30, 1), place(40, 0), place(50, 1);
  const World world(b);
  const auto seen = [&](double x, double y) {
    const Vec3 origin = splat(float(x), float(y), 5), down = splat(0, 0, -1);
    const RayHits hits = world.tracer.intersect(all_lanes(), origin, down);
    EXPECT_TRUE(all(hits.hit));
    const Surface s = surface_at(world.primitives, world.placements, hits, origin, down, {});
    expect_near(lane_of(s.geometric_normal, 0), {0, 0, 1}, 1e-5);
    return std::pair(static_cast<int>(lane_word(as_uint(s.shape), 0)),
                     static_cast<int>(lane_word(as_uint(hits.instance), 0)));
  };
  EXPECT_EQ(seen(0, 0), std::pair(4, -1));
  EXPECT_EQ(seen(0.9, 0.9), std::pair(2, -1));
  EXPECT_EQ(seen(10, 0), std::pair(0, 0));
  EXPECT_EQ(seen(10.9, 0.9), std::pair(5, 0));
  EXPECT_EQ(seen(20.9, 0.9), std::pair(1, 1));
  EXPECT_EQ(seen(30, 0), std::pair(0, 2));
  EXPECT_EQ(seen(40.9, -0.9), std::pair(1, 3));
  EXPECT_EQ(seen(50.9, 0.9), std::pair(5, 4));
}

// The same while things move and deform, each at a place of its own: two groups, shapes by
// themselves, of one kind and of several, and a mesh that deforms where it is.
TEST(Instances, WhatMovesIsToldApart) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  const scene::Motion down{
      {{0, motion::test::translated(0, 0, 1)}, {1, motion::test::translated(0, 0, -1)}}};
  const auto last = [&]() -> scene::Shape& { return b.description().shapes.back(); };
  const auto quad_at = [](double x) { return test::quad({x - 1, -1, -0.5}, {2, 0, 0}, {0, 2, 0}); };
  b.shape(test::quad({-1, -1, -9}, {2, 0, 0}, {0, 2, 0}), grey);        // 0, in the world
  b.shape(scene::Sphere{{0, 0, 0}, 0.4}, grey), last().group = 0;       // 1
  b.shape(quad_at(0), grey), last().group = 0;                          // 2
  b.shape(quad_at(60), grey), last().motion = down;                     // 3, moves by itself
  b.shape(scene::Sphere{{0, 0, -5}, 0.5}, grey);                        // 4, in the world
  b.shape(scene::Sphere{{70, 0, 0}, 0.5}, grey), last().motion = down;  // 5
  b.shape(test::disk({0, 0, 0}, 0.5), grey), last().group = 1;          // 6
  b.shape(quad_at(0), grey), last().group = 1;                          // 7
  scene::TriangleMesh cloth = quad_at(80);
  std::vector<float> lifted = cloth.positions;
  for (size_t i = 2; i < lifted.size(); i += 3) lifted[i] += 0.25F;
  cloth.keys = {{cloth.positions, cloth.normals}, {lifted, cloth.normals}};
  b.shape(cloth, grey), last().key_times = {0, 1};  // 8, deforms in its place
  const auto place = [&](double x, scene::Index group, const scene::Motion& motion) {
    b.description().instances.push_back({motion::test::translated(x, 0, 0), group, {}, motion});
  };
  place(10, 1, down), place(20, 0, {}), place(30, 0, down), place(40, 1, {}), place(50, 0, down);
  const World world(b.take(), {0, 1});
  for (const float time : {0.F, 0.3F, 1.F}) {
    const auto seen = [&](double x, double y) {
      const Vec3 origin = splat(float(x), float(y), 5), below = splat(0, 0, -1);
      const RayHits hits = world.tracer.intersect(all_lanes(), origin, below, Float(time));
      EXPECT_TRUE(all(hits.hit));
      const Surface s = surface_at(world.primitives, world.placements, hits, origin, below, {});
      expect_near(lane_of(s.geometric_normal, 0), {0, 0, 1}, 1e-5);
      const auto instance = static_cast<int>(lane_word(as_uint(hits.instance), 0));
      if (instance >= 0) {
        const auto& record = world.primitives.instances[static_cast<size_t>(instance)];
        if (record.shape != scene::kNone)
          return std::pair(static_cast<int>(lane_word(as_uint(s.shape), 0)),
                           -2 - static_cast<int>(record.shape));
      }
      return std::pair(static_cast<int>(lane_word(as_uint(s.shape), 0)), instance);
    };
    EXPECT_EQ(seen(0, 0), std::pair(4, -1));
    EXPECT_EQ(seen(0.9, 0.9), std::pair(0, -1));
    EXPECT_EQ(seen(10, 0), std::pair(6, 0));
    EXPECT_EQ(seen(10.9, 0.9), std::pair(7, 0));
    EXPECT_EQ(seen(20, 0), std::pair(1, 1));
    EXPECT_EQ(seen(20.9, 0.9), std::pair(2, 1));
    EXPECT_EQ(seen(30, 0), std::pair(1, 2));
    EXPECT_EQ(seen(30.9, -0.9), std::pair(2, 2));
    EXPECT_EQ(seen(40.9, 0.9), std::pair(7, 3));
    EXPECT_EQ(seen(50.9, 0.9), std::pair(2, 4));
    EXPECT_EQ(seen(60.9, 0.9), std::pair(3, -2 - 3));
    EXPECT_EQ(seen(70, 0), std::pair(5, -2 - 5));
    EXPECT_EQ(seen(80.9, 0.9), std::pair(8, -2 - 8));
  }
}

TEST(Instances, AGroupWithoutInstancesIsNotSeen) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 1}, b.diffuse(0.5F));
  b.description().shapes[0].group = 0;
  const World world(b);
  EXPECT_TRUE(none(world.tracer.intersect(all_lanes(), splat(0, 0, 5), splat(0, 0, -1)).hit));
  const Bounds box = bounds_of(world.primitives, world.placements);
  EXPECT_GT(box.lower[0], box.upper[0]);
}

TEST(Instances, AnInstanceOfAnEmptyGroupShowsNothing) {
  test::SceneBuilder b;
  b.description().instances.push_back({kRotated, 2, {}});
  b.shape(scene::Sphere{{0, 0, 0}, 1}, b.diffuse(0.5F));
  const World world(b);
  EXPECT_TRUE(all(world.tracer.intersect(all_lanes(), splat(0, 0, 5), splat(0, 0, -1)).hit));
}

TEST(Instances, ShareOneTableOfVertices) {
  test::SceneBuilder b;
  b.shape(random_mesh(2000, 1), b.diffuse(0.5F));
  b.description().shapes[0].group = 0;
  for (int i = 0; i < 100; ++i)
    b.description().instances.push_back({product(kRotated, scaled(1, 1, 1 + i)), 0, {}});
  const World world(b);
  EXPECT_EQ(world.primitives.vertex_count, 6000U);
  EXPECT_LT(world.primitives.bytes(), 500000U);
  EXPECT_LT(world.tracer.bytes(), 2000000U);
}

TEST(Bounds, HoldEverythingThatIsSeen) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(scene::Sphere{{1, 0, 0}, 0.5}, grey);
  b.description().shapes[0].group = 0;
  b.description().instances.push_back({scaled(2, 3, -4), 0, {}});
  b.shape(test::quad({-1, -1, 7}, {1, 0, 0}, {0, 1, 0}), grey);
  b.shape(scene::Cylinder{{1, 0, 0, 0, 0, 1, 0, 9, 0, 0, -5, 0, 0, 0, 0, 1}}, grey);
  const World world(b);
  const Bounds box = bounds_of(world.primitives, world.placements);
  const double lower[3] = {-1, -1.5, -5}, upper[3] = {3, 10, 7};
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(box.lower[k], lower[k], 1e-4);
    EXPECT_NEAR(box.upper[k], upper[k], 1e-4);
  }
}

// Both of the world and of a group: Embree gives up, and the process goes on.
TEST(TracerMemory, TreesBeyondTheLimitAreRefused) {
  test::SceneBuilder inside, outside;
  for (test::SceneBuilder* b : {&inside, &outside})
    b->shape(random_mesh(20000, 4), b->diffuse(0.5F));
  inside.description().shapes[0].group = 0;
  inside.description().instances.push_back({scaled(1, 1, 1), 0, {}});
  for (test::SceneBuilder* b : {&inside, &outside}) {
    const World world(*b);
    const uint64_t bytes = world.tracer.bytes();
    EXPECT_GT(bytes, 20000U);
    EXPECT_THROW(Tracer(world.primitives, world.placements, "avx2", bytes / 4), std::bad_alloc);
    EXPECT_THROW(Tracer(world.primitives, world.placements, "avx2", 0), std::bad_alloc);
    // While it is built a tree needs more than it keeps.
    const Tracer fits(world.primitives, world.placements, "avx2", 8 * bytes);
    EXPECT_EQ(fits.bytes(), bytes);
  }
}

// What instances that move keep is counted, what only building takes is not.
TEST(TracerMemory, MovingInstancesCount) {
  constexpr size_t kInstances = 2000;
  test::SceneBuilder b;
  b.shape(scene::Sphere{{1, 0, 0}, 0.1}, b.diffuse(0.5F));
  b.description().shapes[0].group = 0;
  const scene::Motion turns{
      {motion::test::turn_key(0, {0, 1, 0}, 0), motion::test::turn_key(1, {0, 1, 0}, 1080)}};
  for (size_t i = 0; i < kInstances; ++i)
    b.description().instances.push_back({scaled(1, 1, 1), 0, {}, turns});
  const World world(b.take(), {0, 1});
  const uint64_t bytes = world.tracer.bytes();
  EXPECT_GT(bytes, kInstances * 100);
  const uint64_t boxes = kInstances * 30 * sizeof(Bounds);
  EXPECT_THROW(Tracer(world.primitives, world.placements, "avx2", boxes), std::bad_alloc);
  const Tracer fits(world.primitives, world.placements, "avx2", 64 * bytes);
  EXPECT_EQ(fits.bytes(), bytes);
}

}  // namespace
}  // namespace metrofarm::geometry
