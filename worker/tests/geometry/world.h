// A traced scene, and what single rays meet in it.
#pragma once

#include <gtest/gtest.h>

#include "geometry/surface.h"
#include "tests/support/lane_tools.h"
#include "tests/support/scenes.h"

namespace metrofarm::geometry {

struct World {
  explicit World(scene::SceneDescription description, const motion::Interval& interval = {})
      : scene(std::move(description)),
        primitives(build_primitives(scene)),
        placements(scene, primitives, interval),
        tracer(primitives, placements, "avx2") {}
  explicit World(test::SceneBuilder& builder) : World(builder.take()) {}

  // The surface that a ray meets. Requires: it meets one.
  Surface look(test::Double3 from, test::Double3 direction) const {
    const Vec3 o = test::splat(from), d = test::splat(normalize(direction));
    const RayHits hits = tracer.intersect(all_lanes(), o, d);
    EXPECT_TRUE(all(hits.hit));
    return surface_at(primitives, placements, hits, o, d, {true, true});
  }

  scene::SceneDescription scene;
  Primitives primitives;
  Placements placements;
  Tracer tracer;
};

inline void expect_near(test::Double3 a, test::Double3 b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

inline scene::TriangleMesh smooth_triangle() {
  scene::TriangleMesh mesh;
  mesh.positions = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  mesh.normals = {0, 0, 1, 0.6F, 0, 0.8F, 0, 0.6F, 0.8F};
  mesh.texcoords = {0, 0, 0, 2, 1, 0};
  mesh.indices = {0, 1, 2};
  return mesh;
}

}  // namespace metrofarm::geometry
