// What moves while a shutter is open against the same things where they stand at a ray's time.
#include <gtest/gtest.h>

#include <cmath>
#include <new>

#include "tests/geometry/world.h"
#include "tests/motion/motions.h"
#include "tests/support/statistics.h"

namespace metrofarm::geometry {
namespace {

using motion::test::scaled;
using motion::test::translated;
using motion::test::turn_key;
using motion::test::turned;
using test::Double3;
using test::lane_of;

constexpr float kTimes[] = {0, 0.125F, 0.5F, 0.8F, 1};

// A bumpy ball with vertex normals and texture coordinates.
scene::TriangleMesh ball() {
  constexpr int kAcross = 24, kDown = 12;
  scene::TriangleMesh mesh;
  for (int j = 0; j <= kDown; ++j) {
    for (int i = 0; i <= kAcross; ++i) {
      const double theta = std::numbers::pi * j / kDown, phi = 2 * std::numbers::pi * i / kAcross;
      const Double3 n = {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                         std::cos(theta)};
      const double r = 1 + 0.2 * std::sin(3 * phi) * std::sin(theta);
      for (double v : {r * n.x, r * n.y, r * n.z}) mesh.positions.push_back(static_cast<float>(v));
      for (double v : {n.x, n.y, n.z}) mesh.normals.push_back(static_cast<float>(v));
      mesh.texcoords.push_back(static_cast<float>(i) / kAcross);
      mesh.texcoords.push_back(static_cast<float>(j) / kDown);
    }
  }
  for (uint32_t j = 0; j < kDown; ++j) {
    for (uint32_t i = 0; i < kAcross; ++i) {
      const uint32_t a = j * (kAcross + 1) + i, b = a + 1, c = a + kAcross + 1, d = c + 1;
      for (uint32_t index : {a, c, b, b, c, d}) mesh.indices.push_back(index);
    }
  }
  return mesh;
}

scene::TriangleMesh posed(scene::TriangleMesh mesh, const scene::Matrix& m) {
  const scene::Linear normals = scene::inverse_transpose(scene::linear_part(m));
  for (size_t i = 0; i < mesh.positions.size(); i += 3) {
    Double3 p, n;
    double* to[] = {&p.x, &p.y, &p.z, &n.x, &n.y, &n.z};
    for (int r = 0; r < 3; ++r) {
      *to[r] = m[4 * r + 3];
      for (int k = 0; k < 3; ++k) {
        *to[r] += m[4 * r + k] * mesh.positions[i + k];
        *to[3 + r] += normals[3 * r + k] * mesh.normals[i + k];
      }
    }
    n = normalize(n);
    for (int k = 0; k < 3; ++k) {
      mesh.positions[i + k] = static_cast<float>(*to[k]);
      mesh.normals[i + k] = static_cast<float>(*to[3 + k]);
    }
  }
  return mesh;
}

struct Compared {
  int hits = 0, apart = 0;
};

// Steps follow a motion to a ten-thousandth of what moves, which is up to 5 across.
constexpr double kNear = 1e-3;
// Where vertex normals are stretched before they are interpolated or after makes a difference.
constexpr double kStretchedNormals = 0.1;

// The same rays at one time in the world that moves and in the one that stands.
Compared compare(const World& moving, const World& still, float time,
                 double normal_tolerance = kNear) {
  test::UniformLanes random(7);
  Compared seen;
  for (int i = 0; i < 300; ++i) {
    const Vec3 origin = random.direction() * Float(9.F);
    const Vec3 direction = normalize(random.direction() * Float(2.F) - origin);
    const RayHits a = moving.tracer.intersect(all_lanes(), origin, direction, Float(time));
    const RayHits b = still.tracer.intersect(all_lanes(), origin, direction);
    EXPECT_EQ(
        bits(moving.tracer.occluded(all_lanes(), origin, direction, Float(1e30F), Float(time))),
        bits(a.hit));
    const Surface sa =
        surface_at(moving.primitives, moving.placements, a, origin, direction, {true, true});
    const Surface sb =
        surface_at(still.primitives, still.placements, b, origin, direction, {true, true});
    for (int lane = 0; lane < kLanes; ++lane) {
      if (!test::lane_set(a.hit | b.hit, lane)) continue;
      ++seen.hits;
      // Rays along edges may be decided by rounding.
      if (!test::lane_set(a.hit & b.hit, lane) || std::fabs(lane_value(a.t - b.t, lane)) > 2e-3) {
        ++seen.apart;
        continue;
      }
      const double cosine = dot(lane_of(sb.geometric_normal, lane), lane_of(direction, lane));
      if (std::fabs(cosine) < 0.1) continue;
      expect_near(lane_of(sa.position, lane), lane_of(sb.position, lane),
                  kNear / std::fabs(cosine));
      if (lane_word(as_uint(a.primitive), lane) != lane_word(as_uint(b.primitive), lane)) continue;
      expect_near(lane_of(sa.geometric_normal, lane), lane_of(sb.geometric_normal, lane),
                  std::min(normal_tolerance, 3 * kNear));
      expect_near(lane_of(sa.shading_normal, lane), lane_of(sb.shading_normal, lane),
                  normal_tolerance / std::fabs(cosine));
      EXPECT_NEAR(lane_value(sa.point.uv.x, lane), lane_value(sb.point.uv.x, lane), 2e-3);
      EXPECT_NEAR(lane_value(sa.point.uv.y, lane), lane_value(sb.point.uv.y, lane), 2e-3);
      expect_near(lane_of(sa.dp_du, lane), lane_of(sb.dp_du, lane), 2e-2);
    }
  }
  return seen;
}

void expect_alike(const Compared& seen) {
  EXPECT_GT(seen.hits, 200);
  EXPECT_LE(seen.apart, seen.hits / 200);
}

std::vector<scene::Motion> motions() {
  std::vector<scene::Motion> all;
  all.push_back({{{0, translated(-1, 0, 0)}, {1, translated(1, 0.5, 0)}}});
  all.push_back({{turn_key(0, {0, 1, 0}, 0), turn_key(1, {0, 1, 0}, 90)}});
  all.push_back({{turn_key(0, {0, 1, 0}, 0), turn_key(1, {0, 1, 0}, 1080)}});
  all.push_back({{{0, scaled(1, 2, 0.5)},
                  {1, motion::multiply(turned({1, 1, 0}, 70), scaled(0.5, 1, 1.5))}}});
  scene::Motion many{{}, scene::MotionPath::kCatmullRom};
  for (int i = 0; i <= 16; ++i)
    many.keys.push_back(turn_key(i / 16.0, {0, 0, 1}, 25.0 * i, {std::sin(0.5 * i), 0, 0}));
  all.push_back(many);
  return all;
}

TEST(MovingGeometry, IsWhereItIsAtTheRaysTime) {
  for (const scene::Motion& motion : motions()) {
    test::SceneBuilder b;
    b.shape(ball(), b.diffuse(0.5F));
    b.description().shapes[0].motion = motion;
    const World moving(b.take(), {0, 1});
    EXPECT_TRUE(moving.placements.anything_moves());
    const bool stretches = !moving.placements.keeps_angles(0);
    for (float time : kTimes) {
      test::SceneBuilder s;
      s.shape(posed(ball(), motion::Track(motion).at(double(time))), s.diffuse(0.5F));
      expect_alike(compare(moving, World(s), time, stretches ? kStretchedNormals : kNear));
    }
  }
}

// Instances whose group has a matrix of its own, and analytic shapes in a space that moves: small
// ones, whose normals turn the more for the same distance.
TEST(MovingGeometry, InstancesAndAnalyticShapesMove) {
  const scene::Motion motion = motions()[1];
  const scene::Matrix inner = translated(1, 0, 0.5);
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 0.5}, b.diffuse(0.5F));
  b.shape(scene::Disk{translated(1, 0, 0)}, 0).shape(scene::Cylinder{scaled(0.5, 0.5, 2)}, 0);
  for (scene::Shape& shape : b.description().shapes) shape.group = 0;
  b.description().instances.push_back({inner, 0, {}, motion});
  const World moving(b.take(), {0, 1});
  for (float time : kTimes) {
    test::SceneBuilder s;
    s.shape(scene::Sphere{{0, 0, 0}, 0.5}, s.diffuse(0.5F));
    s.shape(scene::Disk{translated(1, 0, 0)}, 0).shape(scene::Cylinder{scaled(0.5, 0.5, 2)}, 0);
    for (scene::Shape& shape : s.description().shapes) shape.group = 0;
    s.description().instances.push_back(
        {motion::multiply(motion::Track(motion).at(double(time)), inner), 0, {}});
    expect_alike(compare(moving, World(s), time, 3 * kNear));
  }
}

// One analytic shape that moves by itself, which needs no scene of its own, beside an instance that
// stands where it is at the time.
TEST(MovingGeometry, SingleAnalyticShapesMove) {
  const auto shapes = std::vector<decltype(scene::Shape::geometry)>{
      scene::Sphere{{0.3, 0, 0}, 1}, scene::Disk{scaled(2, 2, 1)},
      scene::Cylinder{scaled(1, 1, 2)}};
  for (const decltype(scene::Shape::geometry)& shape : shapes) {
    for (const scene::Motion& motion : motions()) {
      test::SceneBuilder b;
      b.shape(shape, b.diffuse(0.5F));
      b.description().shapes[0].motion = motion;
      const World moving(b.take(), {0, 1});
      const bool stretches = !moving.placements.keeps_angles(0);
      for (float time : {0.F, 0.37F, 1.F}) {
        test::SceneBuilder s;
        s.shape(shape, s.diffuse(0.5F));
        s.description().shapes[0].group = 0;
        s.description().instances.push_back({motion::Track(motion).at(double(time)), 0, {}});
        expect_alike(compare(moving, World(s), time, stretches ? kStretchedNormals : 6 * kNear));
      }
    }
  }
}

// Each lane has a time of its own.
TEST(MovingGeometry, LanesHaveTheirOwnTimes) {
  test::SceneBuilder b;
  b.shape(test::quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}), b.diffuse(0.5F));
  b.description().shapes[0].motion = {{{0, translated(0, 0, 1)}, {2, translated(0, 0, 9)}}};
  const World world(b.take(), {0, 2});
  const Float times = Float(_mm256_setr_ps(0, 0.125F, 0.25F, 0.375F, 0.5F, 0.625F, 0.75F, 1));
  const RayHits hits =
      world.tracer.intersect(all_lanes(), splat(0.2F, 0.1F, 0), splat(0, 0, 1), times);
  ASSERT_TRUE(all(hits.hit));
  for (int lane = 0; lane < kLanes; ++lane)
    EXPECT_NEAR(lane_value(hits.t, lane), 1 + 8 * lane_value(times, lane), 1e-5);
}

TEST(MovingGeometry, StandsAtAnInstantAndOutsideItsKeys) {
  for (const motion::Interval& interval : {motion::Interval{0.5, 0.5}, {3, 4}, {-1, 0}}) {
    test::SceneBuilder b;
    b.shape(ball(), b.diffuse(0.5F));
    b.description().shapes[0].motion = motions()[1];
    const World world(b.take(), interval);
    EXPECT_FALSE(world.placements.anything_moves());
    test::SceneBuilder s;
    s.shape(posed(ball(), motion::Track(motions()[1]).at(interval.begin)), s.diffuse(0.5F));
    expect_alike(compare(world, World(s), 0));
  }
}

// A ray that leaves a surface does not meet it again, whatever the time.
TEST(MovingGeometry, RaysLeaveWhatMoves) {
  for (const scene::Motion& motion : motions()) {
    test::SceneBuilder b;
    b.shape(scene::Sphere{{0.3, 0, 0}, 1}, b.diffuse(0.5F));
    b.shape(test::quad({-8, -8, -3}, {16, 0, 0}, {0, 16, 0}), 0);
    b.description().shapes[0].motion = motion;
    b.description().shapes[1].motion = motion;
    const World world(b.take(), {0, 1});
    test::UniformLanes random(3);
    int tried = 0;
    for (int i = 0; i < 300; ++i) {
      const Float time = random.next();
      const Vec3 origin = random.direction() * Float(9.F);
      const Vec3 direction = normalize(random.direction() - origin);
      const RayHits hits = world.tracer.intersect(all_lanes(), origin, direction, time);
      const Surface s = surface_at(world.primitives, world.placements, hits, origin, direction, {});
      // Outwards, as seen from where the ray came from: all is convex.
      const Vec3 n = select(dot(s.geometric_normal, direction) > Float(0.F), -s.geometric_normal,
                            s.geometric_normal);
      const Vec3 out = normalize(n + random.direction() * Float(0.99F));
      const Vec3 start = offset_origin(s.position, s.geometric_normal, s.offset, out);
      const RayHits again = world.tracer.intersect(hits.hit, start, out, time);
      const Mask near =
          again.hit & (again.t < Float(0.05F)) & equal(again.primitive, hits.primitive);
      tried += __builtin_popcount(bits(hits.hit));
      EXPECT_TRUE(none(near));
    }
    EXPECT_GT(tried, 500);
  }
}

TEST(MovingGeometry, BoundsHoldAllPoses) {
  for (const scene::Motion& motion : motions()) {
    test::SceneBuilder b;
    b.shape(ball(), b.diffuse(0.5F));
    b.description().shapes[0].motion = motion;
    const World world(b.take(), {0, 1});
    const Bounds box = bounds_of(world.primitives, world.placements);
    Bounds tight = box;
    for (int k = 0; k < 3; ++k) std::swap(tight.lower[k], tight.upper[k]);
    for (int i = 0; i <= 400; ++i) {
      const scene::TriangleMesh mesh = posed(ball(), motion::Track(motion).at(i / 400.0));
      for (size_t v = 0; v < mesh.positions.size(); ++v) {
        EXPECT_GE(mesh.positions[v], box.lower[v % 3] - 2e-5);
        EXPECT_LE(mesh.positions[v], box.upper[v % 3] + 2e-5);
        tight.lower[v % 3] = std::min(tight.lower[v % 3], mesh.positions[v]);
        tight.upper[v % 3] = std::max(tight.upper[v % 3], mesh.positions[v]);
      }
    }
    // Boxes of turned boxes are wider than what is in them, by sqrt(3) at most.
    for (int k = 0; k < 3; ++k)
      EXPECT_LE(box.upper[k] - box.lower[k], 1.8F * (tight.upper[k] - tight.lower[k]));
  }
}

// What has no extent is nowhere to be met, and harms nothing around it.
TEST(MovingGeometry, PointsAndTinyThingsMove) {
  test::SceneBuilder b;
  b.shape(test::quad({1, 1, 1}, {0, 0, 0}, {0, 0, 0}), b.diffuse(0.5F));
  b.shape(test::quad({0, 0, 0}, {0, 0, 0}, {0, 0, 0}), 0);
  b.shape(test::quad({0, 0, 0}, {1e-30, 0, 0}, {0, 1e-30, 0}), 0);
  b.shape(scene::Sphere{{0, 0, -6}, 1}, 0);
  for (scene::Shape& shape : b.description().shapes) shape.motion = motions()[1];
  const World world(b.take(), {0, 1});
  for (size_t i = 0; i < world.placements.count(); ++i)
    EXPECT_LE(world.placements.step_count(i), 129);
  const Bounds box = bounds_of(world.primitives, world.placements);
  for (int k = 0; k < 3; ++k) {
    EXPECT_TRUE(std::isfinite(box.lower[k]) && std::isfinite(box.upper[k]));
    EXPECT_LT(box.upper[k] - box.lower[k], 20);
  }
  const Surface met = world.look({0, 5, -6}, {0, -1, 0});
  expect_near(lane_of(met.position, 0), {0, 1, -6}, kNear);
}

// ---- meshes that deform ----

scene::TriangleMesh deforming_ball(std::vector<double>& times) {
  scene::TriangleMesh mesh = ball();
  times = {0, 0.3, 1};
  const scene::Matrix poses[] = {scaled(1, 1, 1), scaled(1.5, 0.7, 1),
                                 motion::multiply(translated(1, 0, 0), scaled(0.6, 1, 2))};
  for (const scene::Matrix& m : poses) {
    const scene::TriangleMesh key = posed(ball(), m);
    mesh.keys.push_back({key.positions, key.normals});
  }
  return mesh;
}

scene::TriangleMesh between(const scene::TriangleMesh& mesh, const std::vector<double>& times,
                            double time) {
  size_t next = 1;
  while (next + 1 < times.size() && times[next] < time) ++next;
  const double s = (time - times[next - 1]) / (times[next] - times[next - 1]);
  scene::TriangleMesh out = mesh;
  out.keys.clear();
  const auto mix = [&](float a, float b) { return static_cast<float>((1 - s) * a + s * b); };
  for (size_t i = 0; i < out.positions.size(); ++i) {
    const scene::VertexKey &a = mesh.keys[next - 1], &b = mesh.keys[next];
    out.positions[i] = mix(a.positions[i], b.positions[i]);
    out.normals[i] = mix(a.normals[i], b.normals[i]);
  }
  return out;
}

TEST(DeformingMesh, IsWhereItIsAtTheRaysTime) {
  test::SceneBuilder b;
  std::vector<double> times;
  const scene::TriangleMesh mesh = deforming_ball(times);
  b.shape(test::quad({-9, -9, -4}, {18, 0, 0}, {0, 18, 0}), b.diffuse(0.5F));
  b.shape(mesh, 0);
  b.description().shapes[1].key_times = times;
  const World moving(b.take(), {0, 1});
  EXPECT_TRUE(moving.placements.anything_moves());
  for (float time : {0.F, 0.2F, 0.3F, 0.65F, 1.F}) {
    test::SceneBuilder s;
    s.shape(test::quad({-9, -9, -4}, {18, 0, 0}, {0, 18, 0}), s.diffuse(0.5F));
    s.shape(between(mesh, times, double(time)), 0);
    expect_alike(compare(moving, World(s), time));
  }
}

TEST(DeformingMesh, MovesAsAWholeToo) {
  test::SceneBuilder b;
  std::vector<double> times;
  const scene::TriangleMesh mesh = deforming_ball(times);
  const scene::Motion motion = motions()[1];
  b.shape(mesh, b.diffuse(0.5F));
  b.description().shapes[0].key_times = times;
  b.description().shapes[0].motion = motion;
  const World moving(b.take(), {0.1, 0.5});
  for (float time : {0.F, 0.5F, 1.F}) {
    const double at = 0.1 + 0.4 * double(time);
    test::SceneBuilder s;
    s.shape(posed(between(mesh, times, at), motion::Track(motion).at(at)), s.diffuse(0.5F));
    expect_alike(compare(moving, World(s), time, kStretchedNormals));
  }
}

TEST(DeformingMesh, StandsAtAnInstant) {
  test::SceneBuilder b;
  std::vector<double> times;
  const scene::TriangleMesh mesh = deforming_ball(times);
  b.shape(mesh, b.diffuse(0.5F));
  b.description().shapes[0].key_times = times;
  const World world(b.take(), {0.5, 0.5});
  EXPECT_FALSE(world.placements.anything_moves());
  test::SceneBuilder s;
  s.shape(between(mesh, times, 0.5), s.diffuse(0.5F));
  expect_alike(compare(world, World(s), 0));
}

TEST(DeformingMesh, TablesBeyondTheLimitAreRefused) {
  for (const bool smooth : {true, false}) {
    test::SceneBuilder b;
    std::vector<double> times;
    scene::TriangleMesh mesh = deforming_ball(times);
    if (!smooth) mesh.normals.clear();
    for (scene::VertexKey& key : mesh.keys)
      if (!smooth) key.normals.clear();
    const size_t vertices = mesh.positions.size() / 3;
    for (int i = 0; i < 2; ++i) {
      b.shape(mesh, b.diffuse(0.5F));
      b.description().shapes.back().key_times = times;
    }
    const World world(b.take(), {0, 1});
    const Deformations& tables = world.placements.deformations();
    const auto steps = static_cast<size_t>(tables.step_count(0) + tables.step_count(1));
    EXPECT_GT(steps, 4U);
    const uint64_t bytes = (3 * steps * vertices + kSpareFloats) * sizeof(float) * (smooth ? 2 : 1);
    EXPECT_EQ(tables.bytes(), bytes + 2 * 4 * sizeof(int32_t)) << "no more than asked for";
    const motion::Interval interval = {0, 1};
    EXPECT_THROW(Placements(world.scene, world.primitives, interval, bytes - 1), std::bad_alloc);
    EXPECT_NO_THROW(Placements(world.scene, world.primitives, interval, bytes));
  }
}

}  // namespace
}  // namespace metrofarm::geometry
