// A ray that leaves a surface doesn't meet it again, at any scale and place.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "geometry/surface.h"
#include "tests/geometry/world.h"

namespace metrofarm::geometry {
namespace {

using test::Double3;

struct Case {
  double scale;   // size of the shape
  double center;  // distance from the origin, in sizes
};

class OffsetTest : public testing::TestWithParam<Case> {
 protected:
  scene::Point center() const {
    const double c = GetParam().center * GetParam().scale;
    return {c, -0.7 * c, 0.4 * c};
  }

  Vec3 at(const Vec3& v) const {
    const scene::Point c = center();
    return v * Float(static_cast<float>(GetParam().scale)) + test::splat(Double3{c[0], c[1], c[2]});
  }
};

// Rays from points of a lone triangle or disk to both sides never meet it.
void expect_no_return(const World& world, const Vec3& origin, const Vec3& target,
                      test::UniformLanes& random, int& tried) {
  const Tracer& tracer = world.tracer;
  const Vec3 direction = normalize(target - origin);
  const RayHits hits = tracer.intersect(all_lanes(), origin, direction);
  const Surface s = surface_at(world.primitives, world.placements, hits, origin, direction, {});
  for (int i = 0; i < 4; ++i) {
    Vec3 out = random.direction();
    // Half of them nearly along the surface.
    if (i % 2 == 0)
      out = normalize(out - s.geometric_normal * (dot(out, s.geometric_normal) * Float(0.999F)));
    const Vec3 start = offset_origin(s.position, s.geometric_normal, s.offset, out);
    const RayHits again = tracer.intersect(hits.hit, start, out);
    tried += __builtin_popcount(bits(hits.hit));
    EXPECT_TRUE(none(again.hit));
    EXPECT_TRUE(none(tracer.occluded(hits.hit, start, out, Float(1e30F))));
  }
}

TEST_P(OffsetTest, FlatShapesAreNotMetAgain) {
  std::mt19937_64 engine(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  test::UniformLanes random(5);
  int tried = 0;
  for (int shape = 0; shape < 60; ++shape) {
    test::SceneBuilder b;
    const scene::Point c = center();
    const double s = GetParam().scale;
    if (shape % 3 == 0) {
      b.shape(test::disk(c, s), b.diffuse(0.5F));
    } else {
      scene::TriangleMesh mesh;
      for (int i = 0; i < 9; ++i)
        mesh.positions.push_back(static_cast<float>(c[i % 3] + s * uniform(engine)));
      mesh.indices = {0, 1, 2};
      b.shape(mesh, b.diffuse(0.5F));
    }
    const World world(b);
    for (int i = 0; i < 20; ++i) {
      const Vec3 origin = at(random.direction() * Float(5.F));
      expect_no_return(world, origin, at(random.direction() * Float(0.5F)), random, tried);
    }
  }
  EXPECT_GT(tried, 1000);
}

TEST_P(OffsetTest, SpheresAreMetAgainOnlyAcross) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{center(), GetParam().scale}, b.diffuse(0.5F));
  const World world(b);
  test::UniformLanes random(6);
  for (int i = 0; i < 3000; ++i) {
    const Vec3 origin = at(random.direction() * Float(4.F));
    const Vec3 direction = normalize(at(random.direction() * Float(0.7F)) - origin);
    const RayHits hits = world.tracer.intersect(all_lanes(), origin, direction);
    const Surface s = surface_at(world.primitives, world.placements, hits, origin, direction, {});
    const Vec3 out = random.direction();
    const Float cosine = dot(out, s.geometric_normal);
    const Vec3 start = offset_origin(s.position, s.geometric_normal, s.offset, out);
    const RayHits again = world.tracer.intersect(hits.hit, start, out);
    EXPECT_TRUE(none(again.hit & (cosine > Float(0.F))));
    // Inwards it meets the far side, a chord of length 2 r cos away.
    const Mask deep = hits.hit & (cosine < Float(-0.1F));
    EXPECT_EQ(bits(again.hit & deep), bits(deep));
    const Float chord = Float(-2.F * static_cast<float>(GetParam().scale)) * cosine;
    EXPECT_TRUE(none(deep & (again.t < chord * Float(0.9F))));
  }
}

// A ray that leaves a tube's wall outwards is gone, one that leaves it inwards meets the far side.
TEST_P(OffsetTest, CylindersAreMetAgainOnlyAcross) {
  test::SceneBuilder b;
  const scene::Point c = center();
  const double s = GetParam().scale;
  b.shape(scene::Cylinder{{0, 0, 100 * s, c[0] - 50 * s, s, 0, 0, c[1], 0, s, 0, c[2], 0, 0, 0, 1}},
          b.diffuse(0.5F));
  const World world(b);
  test::UniformLanes random(6);
  for (int i = 0; i < 3000; ++i) {
    const Vec3 origin = at(random.direction() * Float(4.F));
    const Vec3 direction = normalize(at(random.direction() * Float(0.7F)) - origin);
    const RayHits hits = world.tracer.intersect(all_lanes(), origin, direction);
    const Surface surface =
        surface_at(world.primitives, world.placements, hits, origin, direction, {});
    const Vec3 out = random.direction();
    const Float cosine = dot(out, surface.geometric_normal);
    const Vec3 start =
        offset_origin(surface.position, surface.geometric_normal, surface.offset, out);
    const RayHits again = world.tracer.intersect(hits.hit, start, out);
    EXPECT_TRUE(none(again.hit & (cosine > Float(0.F))));
    const Mask deep = hits.hit & (cosine < Float(-0.1F));
    EXPECT_EQ(bits(again.hit & deep), bits(deep));
    const Float chord = Float(-2.F * static_cast<float>(s)) * cosine;
    EXPECT_TRUE(none(deep & (again.t < chord * Float(0.9F))));
  }
}

// The offset stays a small part of the shape wherever floats can resolve the shape.
TEST_P(OffsetTest, OffsetsAreSmall) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{center(), GetParam().scale}, b.diffuse(0.5F));
  const World world(b);
  const Vec3 origin = at(splat(0, 0, 5));
  const RayHits hits = world.tracer.intersect(all_lanes(), origin, splat(0, 0, -1));
  ASSERT_TRUE(all(hits.hit));
  const Surface s =
      surface_at(world.primitives, world.placements, hits, origin, splat(0, 0, -1), {});
  EXPECT_LT(lane_value(s.offset, 0), GetParam().scale * (1 + GetParam().center) * 1e-4);
  EXPECT_GT(lane_value(s.offset, 0), 0);
}

INSTANTIATE_TEST_SUITE_P(Scales, OffsetTest,
                         testing::Values(Case{1e-4, 0}, Case{1, 0}, Case{1e6, 0}, Case{1, 30},
                                         Case{1e-4, 30}, Case{1e6, 30}, Case{1, 1000}));

}  // namespace
}  // namespace metrofarm::geometry
