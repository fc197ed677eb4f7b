// Embree and the analytic shapes against brute force in doubles.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <vector>

#include "geometry/tracer.h"
#include "tests/geometry/world.h"

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

// Independent of the code's formulas: half-open steps of the ray's distance from the wall, each
// sign change bisected.
Answer meet_cylinder(const float* c, const Ray& ray) {
  const Double3 center{c[0], c[1], c[2]}, x{c[3], c[4], c[5]}, z{c[9], c[10], c[11]};
  const Double3 axis = normalize(z);
  const auto beyond_wall = [&](double t) {
    const Double3 p = ray.origin + ray.direction * t - center;
    return length(p - axis * dot(p, axis)) - length(x);
  };
  // The ray is nearest to the axis at `middle`; on both sides the distance only grows.
  const Double3 d = ray.direction - axis * dot(ray.direction, axis);
  const Double3 o = ray.origin - center;
  const double middle = -dot(o, d) / dot(d, d);
  Answer answer;
  answer.at_edge = std::fabs(beyond_wall(middle)) < 1e-4;
  if (beyond_wall(middle) > 0) return answer;
  for (double side : {-1.0, 1.0}) {
    double inside = 0, outside = 100 / length(d);
    for (int i = 0; i < 200; ++i) {
      const double half = 0.5 * (inside + outside);
      (beyond_wall(middle + side * half) < 0 ? inside : outside) = half;
    }
    const double t = middle + side * inside;
    const double height = dot(ray.origin + ray.direction * t - center, axis) / length(z);
    if (t <= 0) continue;
    answer.at_edge = answer.at_edge || std::min(std::fabs(height), std::fabs(height - 1)) < 1e-4;
    if (height >= 0 && height <= 1) answer.t = std::min(answer.t, t);
  }
  return answer;
}

Answer meet(const Primitives& p, int32_t primitive, const Ray& ray) {
  if (primitive < p.triangle_count) return meet_triangle(p, primitive, ray);
  const int32_t i = primitive - p.triangle_count;
  const float* data = &p.analytic[size_t(i) * kAnalyticStride];
  switch (static_cast<AnalyticKind>(p.analytic_kind[i])) {
    case AnalyticKind::kSphere:
      return meet_sphere(data, ray);
    case AnalyticKind::kDisk:
      return meet_disk(data, ray);
    case AnalyticKind::kCylinder:
      return meet_cylinder(data, ray);
  }
  return {};
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

struct Counts {
  int triangles, spheres, disks, cylinders;
};

scene::SceneDescription random_scene(Counts counts) {
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto point = [&] {
    return scene::Point{uniform(random), uniform(random), uniform(random)};
  };
  test::SceneBuilder b;
  const scene::Index grey = b.diffuse(0.5F);
  // Half-axes of these lengths along a random frame.
  const auto placed = [&](double length_x, double length_y, double length_z) -> scene::Matrix {
    const Frame f =
        frame_around(normalize(test::splat(Double3{uniform(random), uniform(random), 2})));
    const Double3 u = test::lane_of(f.s, 0) * length_x, v = test::lane_of(f.t, 0) * length_y;
    const Double3 n = test::lane_of(f.n, 0) * length_z;
    const scene::Point at = point();
    return {u.x, v.x, n.x, at[0], u.y, v.y, n.y, at[1], u.z, v.z, n.z, at[2], 0, 0, 0, 1};
  };
  for (int i = 0; i < counts.disks; ++i) b.shape(scene::Disk{placed(0.3, 0.2, 1)}, grey);
  for (int i = 0; i < counts.cylinders; ++i) {
    const double radius = 0.05 + 0.2 * i / counts.cylinders;
    b.shape(scene::Cylinder{placed(radius, radius, 0.5)}, grey);
  }
  scene::TriangleMesh mesh;
  for (int i = 0; i < counts.triangles; ++i) {
    const scene::Point at = point();
    for (int k = 0; k < 3; ++k) {
      for (int axis = 0; axis < 3; ++axis)
        mesh.positions.push_back(static_cast<float>(at[axis] + 0.2 * uniform(random)));
      mesh.indices.push_back(static_cast<uint32_t>(3 * i + k));
    }
  }
  if (counts.triangles > 0) b.shape(mesh, grey);
  for (int i = 0; i < counts.spheres; ++i)
    b.shape(scene::Sphere{point(), 0.05 + 0.1 * i / counts.spheres}, grey);
  return b.take();
}

void expect_same(const Nearest& truth, const RayHits& hits, int lane) {
  const bool hit = test::lane_set(hits.hit, lane);
  ASSERT_EQ(hit, truth.primitive >= 0);
  if (!hit) return;
  EXPECT_NEAR(lane_value(hits.t, lane), truth.t, 1e-4 * (1 + truth.t));
  if (truth.second - truth.t > 1e-3) {
    EXPECT_EQ(static_cast<int32_t>(lane_word(as_uint(hits.primitive), lane)), truth.primitive);
  }
}

class IntersectionTest : public testing::TestWithParam<Counts> {};

TEST_P(IntersectionTest, AgreesWithBruteForce) {
  const World world(random_scene(GetParam()));
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
  const World world(random_scene(GetParam()));
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
                         testing::Values(Counts{200, 0, 0, 0}, Counts{0, 40, 0, 0},
                                         Counts{0, 0, 40, 0}, Counts{0, 0, 0, 30},
                                         Counts{150, 20, 20, 15}));

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

// Rays along the axis see neither wall nor ends; rays from within see the inside; rays that pass
// by, beside an end or tangentially, see nothing.
TEST(Cylinder, IsAnOpenTube) {
  test::SceneBuilder b;
  b.shape(scene::Cylinder{{2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 3, 1, 0, 0, 0, 1}}, b.diffuse(0.5F));
  const World world(b);
  const auto distance = [&](Double3 origin, Double3 direction) {
    const RayHits hits =
        world.tracer.intersect(all_lanes(), test::splat(origin), test::splat(direction));
    return any(hits.hit) ? lane_value(hits.t, 0) : -1.F;
  };
  EXPECT_EQ(distance({0.5, 0.5, -5}, {0, 0, 1}), -1);
  EXPECT_EQ(distance({2, 0, -5}, {0, 0, 1}), -1);
  EXPECT_NEAR(distance({0, 0, 2}, {1, 0, 0}), 2, 1e-6);
  EXPECT_NEAR(distance({5, 0, 2}, {-1, 0, 0}), 3, 1e-6);
  EXPECT_NEAR(distance({5, 0, 2}, {-2, 0, 0}), 1.5, 1e-6);
  EXPECT_EQ(distance({5, 0, 4.001}, {-1, 0, 0}), -1);
  EXPECT_EQ(distance({5, 0, 0.999}, {-1, 0, 0}), -1);
  EXPECT_NEAR(distance({5, 1.999, 2}, {-1, 0, 0}), 5 - std::sqrt(4 - 1.999 * 1.999), 1e-4);
  EXPECT_EQ(distance({5, 2.001, 2}, {-1, 0, 0}), -1);
  EXPECT_EQ(distance({5, 0, 2}, {1, 0, 0}), -1);
  // In over one end, out through the wall.
  EXPECT_NEAR(distance({0, 0, 0}, {1, 0, 1}), 2, 1e-6);
  EXPECT_NEAR(distance({1e4, 0, 2}, {-1, 0, 0}), 1e4 - 2, 1e-3);
}

}  // namespace
}  // namespace metrofarm::geometry
