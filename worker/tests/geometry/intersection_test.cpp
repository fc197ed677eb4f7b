// Embree and the analytic shapes against brute force in doubles.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <vector>

#include "geometry/tracer.h"
#include "tests/support/lane_tools.h"
#include "tests/support/scenes.h"

namespace metrofarm::geometry {
namespace {

using test::Double3;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Ray {
  Double3 origin, direction;
};

// Nearest t > 0, and whether the ray passes so close to an edge that rounding may decide.
struct Answer {
  double t = kInfinity;
  bool at_edge = false;
};

Double3 vertex(const Primitives& p, int32_t triangle, int k) {
  const float* v = &p.positions[3 * size_t(p.indices[3 * size_t(triangle) + k])];
  return {v[0], v[1], v[2]};
}

Answer meet_triangle(const Primitives& p, int32_t triangle, const Ray& ray) {
  const Double3 a = vertex(p, triangle, 0);
  const Double3 e1 = vertex(p, triangle, 1) - a, e2 = vertex(p, triangle, 2) - a;
  const Double3 h = cross(ray.direction, e2);
  const double det = dot(e1, h);
  const Double3 s = ray.origin - a, q = cross(s, e1);
  const double u = dot(s, h) / det, v = dot(ray.direction, q) / det, t = dot(e2, q) / det;
  const double inside = std::min({u, v, 1 - u - v});
  Answer answer;
  answer.at_edge = std::fabs(inside) < 1e-4 && t > 0;
  if (inside >= 0 && t > 0) answer.t = t;
  return answer;
}

Answer meet_sphere(const float* s, const Ray& ray) {
  const Double3 oc = ray.origin - Double3{s[0], s[1], s[2]};
  const double a = dot(ray.direction, ray.direction), b = dot(oc, ray.direction);
  const double c = dot(oc, oc) - double(s[3]) * s[3];
  const double discriminant = b * b - a * c;
  Answer answer;
  answer.at_edge = std::fabs(discriminant) < 1e-4 * a * s[3] * s[3];
  if (discriminant < 0) return answer;
  const double root = std::sqrt(discriminant);
  for (double t : {(-b - root) / a, (-b + root) / a})
    if (t > 0) answer.t = std::min(answer.t, t);
  return answer;
}

Answer meet_disk(const float* d, const Ray& ray) {
  const Double3 center{d[0], d[1], d[2]}, u{d[3], d[4], d[5]}, v{d[6], d[7], d[8]};
  const Double3 n = cross(u, v);
  const double t = dot(n, center - ray.origin) / dot(n, ray.direction);
  const Double3 p = ray.origin + ray.direction * t - center;
  // The half-axes are perpendicular in these tests.
  const double x = dot(p, u) / dot(u, u), y = dot(p, v) / dot(v, v);
  Answer answer;
  const double r2 = x * x + y * y;
  answer.at_edge = std::fabs(r2 - 1) < 1e-4 && t > 0;
  if (r2 <= 1 && t > 0) answer.t = t;
  return answer;
}

Answer meet(const Primitives& p, int32_t primitive, const Ray& ray) {
  if (primitive < p.triangle_count) return meet_triangle(p, primitive, ray);
  const int32_t i = primitive - p.triangle_count;
  const float* data = &p.analytic[size_t(i) * kAnalyticStride];
  return p.analytic_kind[i] == int32_t(AnalyticKind::kSphere) ? meet_sphere(data, ray)
                                                              : meet_disk(data, ray);
}

struct Nearest {
  double t = kInfinity, second = kInfinity;
  int32_t primitive = -1;
  bool at_edge = false;
};

Nearest brute_force(const Primitives& p, const Ray& ray) {
  Nearest nearest;
  for (int32_t i = 0; i < static_cast<int32_t>(p.shape_of.size()); ++i) {
    const Answer a = meet(p, i, ray);
    nearest.at_edge = nearest.at_edge || a.at_edge;
    if (a.t < nearest.t) {
      nearest.second = nearest.t;
      nearest.t = a.t;
      nearest.primitive = i;
    } else {
      nearest.second = std::min(nearest.second, a.t);
    }
  }
  return nearest;
}

scene::SceneDescription random_scene(int triangles, int spheres, int disks) {
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto point = [&] {
    return scene::Point{uniform(random), uniform(random), uniform(random)};
  };
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  for (int i = 0; i < disks; ++i) {
    const Frame f =
        frame_around(normalize(test::splat(Double3{uniform(random), uniform(random), 2})));
    const Double3 u = test::lane_of(f.s, 0) * 0.3, v = test::lane_of(f.t, 0) * 0.2;
    const Double3 n = test::lane_of(f.n, 0);
    const scene::Point c = point();
    b.shape(
        scene::Disk{{u.x, v.x, n.x, c[0], u.y, v.y, n.y, c[1], u.z, v.z, n.z, c[2], 0, 0, 0, 1}},
        grey);
  }
  scene::TriangleMesh mesh;
  for (int i = 0; i < triangles; ++i) {
    const scene::Point at = point();
    for (int k = 0; k < 3; ++k) {
      for (int axis = 0; axis < 3; ++axis)
        mesh.positions.push_back(static_cast<float>(at[axis] + 0.2 * uniform(random)));
      mesh.indices.push_back(static_cast<uint32_t>(3 * i + k));
    }
  }
  if (triangles > 0) b.shape(mesh, grey);
  for (int i = 0; i < spheres; ++i) b.shape(scene::Sphere{point(), 0.05 + 0.1 * i / spheres}, grey);
  return b.take();
}

struct World {
  explicit World(scene::SceneDescription description)
      : scene(std::move(description)),
        primitives(build_primitives(scene)),
        tracer(primitives, "avx2") {}
  scene::SceneDescription scene;
  Primitives primitives;
  Tracer tracer;
};

void expect_same(const Nearest& truth, const RayHits& hits, int lane) {
  const bool hit = test::lane_set(hits.hit, lane);
  ASSERT_EQ(hit, truth.primitive >= 0);
  if (!hit) return;
  EXPECT_NEAR(lane_value(hits.t, lane), truth.t, 1e-4 * (1 + truth.t));
  if (truth.second - truth.t > 1e-3) {
    EXPECT_EQ(static_cast<int32_t>(lane_word(as_uint(hits.primitive), lane)), truth.primitive);
  }
}

class IntersectionTest : public testing::TestWithParam<std::array<int, 3>> {};

TEST_P(IntersectionTest, AgreesWithBruteForce) {
  const auto [triangles, spheres, disks] = GetParam();
  const World world(random_scene(triangles, spheres, disks));
  test::UniformLanes random(3);
  int compared = 0;
  for (int i = 0; i < 1500; ++i) {
    const Vec3 origin = random.direction() * (Float(2.F) * random.next());
    // Directions need not be unit vectors.
    const Vec3 direction = random.direction() * (Float(0.2F) + Float(3.F) * random.next());
    const Mask active = mask_from_bits(static_cast<uint32_t>(i) | 1U);
    const RayHits hits = world.tracer.intersect(active, origin, direction);
    EXPECT_EQ(bits(hits.hit) & ~bits(active), 0U);
    for (int lane = 0; lane < kLanes; ++lane) {
      const Ray ray{test::lane_of(origin, lane), test::lane_of(direction, lane)};
      const Nearest truth = brute_force(world.primitives, ray);
      if (!test::lane_set(active, lane) || truth.at_edge) continue;
      expect_same(truth, hits, lane);
      ++compared;
    }
  }
  EXPECT_GT(compared, 2000);
}

TEST_P(IntersectionTest, OccludedAgreesWithIntersect) {
  const auto [triangles, spheres, disks] = GetParam();
  const World world(random_scene(triangles, spheres, disks));
  test::UniformLanes random(4);
  const Float far(std::numeric_limits<float>::infinity());
  for (int i = 0; i < 3000; ++i) {
    const Vec3 origin = random.direction() * (Float(2.F) * random.next());
    const Vec3 direction = random.direction();
    const RayHits hits = world.tracer.intersect(all_lanes(), origin, direction);
    EXPECT_EQ(bits(world.tracer.occluded(all_lanes(), origin, direction, far)), bits(hits.hit));
    const Mask before =
        world.tracer.occluded(hits.hit, origin, direction, hits.t * Float(1 - 1e-5F));
    const Mask beyond =
        world.tracer.occluded(hits.hit, origin, direction, hits.t * Float(1 + 1e-5F));
    EXPECT_TRUE(none(before));
    EXPECT_EQ(bits(beyond), bits(hits.hit));
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, IntersectionTest,
                         testing::Values(std::array{200, 0, 0}, std::array{0, 40, 0},
                                         std::array{0, 0, 40}, std::array{150, 30, 30}));

// A sphere of radius 1 seen from 10^4 away: float would lose the surface in its own rounding.
TEST(Sphere, IsMetPreciselyFromAfar) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 1}, b.diffuse(0.5F));
  const World world(b.take());
  for (float offset : {0.F, 0.5F, 0.99F}) {
    const RayHits hits =
        world.tracer.intersect(all_lanes(), splat(offset, 0, -1e4F), splat(0, 0, 1));
    ASSERT_TRUE(all(hits.hit));
    EXPECT_NEAR(lane_value(hits.t, 0), 1e4 - std::sqrt(1 - double(offset) * offset), 1e-3);
  }
  EXPECT_TRUE(
      none(world.tracer.intersect(all_lanes(), splat(1.001F, 0, -1e4F), splat(0, 0, 1)).hit));
}

TEST(Tracer, AnEmptySceneIsNeverMet) {
  const World world(test::SceneBuilder().take());
  EXPECT_TRUE(none(world.tracer.intersect(all_lanes(), splat(0.F), splat(0, 0, 1)).hit));
  EXPECT_TRUE(none(world.tracer.occluded(all_lanes(), splat(0.F), splat(0, 0, 1), Float(1e30F))));
}

TEST(Primitives, AreasAreExact) {
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  b.shape(scene::Sphere{{1, 2, 3}, 2}, grey)
      .shape(test::quad({0, 0, 0}, {3, 0, 0}, {1, 2, 0}), grey)
      .shape(scene::Disk{{2, 0, 0, 5, 0, 3, 0, 5, 0, 0, 1, 5, 0, 0, 0, 1}}, grey);
  const World world(b.take());
  EXPECT_NEAR(area_of(world.primitives, 0), 3, 1e-6);
  EXPECT_NEAR(area_of(world.primitives, 2), 16 * std::numbers::pi, 1e-5);
  EXPECT_NEAR(area_of(world.primitives, 3), 6 * std::numbers::pi, 1e-5);
  EXPECT_EQ(world.primitives.shape_of, (std::vector<int32_t>{1, 1, 0, 2}));
}

}  // namespace
}  // namespace metrofarm::geometry
