#include "geometry/hull.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <numbers>

#include "geometry/analytic.h"
#include "tests/geometry/world.h"
#include "tests/motion/motions.h"

namespace metrofarm::geometry {
namespace {

using motion::test::scaled;
using motion::test::translated;
using motion::test::turn_key;
using motion::test::turned;
using test::Double3;

using Map = std::array<float, 12>;

Map map_of(const scene::Matrix& m) {
  Map map;
  for (size_t i = 0; i < map.size(); ++i) map[i] = static_cast<float>(m[i]);
  return map;
}

Double3 mapped(const Map& m, Double3 p) {
  const auto row = [&](size_t r) {
    return double(m[4 * r]) * p.x + double(m[4 * r + 1]) * p.y + double(m[4 * r + 2]) * p.z +
           double(m[4 * r + 3]);
  };
  return {row(0), row(1), row(2)};
}

double area(const Bounds& b) {
  const double x = b.upper[0] - b.lower[0], y = b.upper[1] - b.lower[1],
               z = b.upper[2] - b.lower[2];
  return x * y + y * z + z * x;
}

// By how much a point stands out; negative inside.
double outside(const Bounds& b, Double3 p) {
  const double at[] = {p.x, p.y, p.z};
  double most = -1e30;
  for (int k = 0; k < 3; ++k) most = std::max({most, b.lower[k] - at[k], at[k] - b.upper[k]});
  return most;
}

Bounds around(const Map& map, const std::vector<Double3>& points) {
  Bounds box = no_bounds();
  for (const Double3& p : points) {
    const Double3 q = mapped(map, p);
    const double at[] = {q.x, q.y, q.z};
    for (int k = 0; k < 3; ++k)
      include(box, k, static_cast<float>(at[k]), static_cast<float>(at[k]));
  }
  return box;
}

// Points all over a unit sphere around a center, as a mesh has them.
std::vector<Double3> sphere_points(Double3 center) {
  std::vector<Double3> points;
  constexpr int kAcross = 120, kDown = 60;
  for (int j = 0; j <= kDown; ++j) {
    for (int i = 0; i < kAcross; ++i) {
      const double theta = std::numbers::pi * j / kDown, phi = 2 * std::numbers::pi * i / kAcross;
      points.push_back({center.x + std::sin(theta) * std::cos(phi),
                        center.y + std::sin(theta) * std::sin(phi), center.z + std::cos(theta)});
    }
  }
  return points;
}

scene::TriangleMesh mesh_of(const std::vector<Double3>& points) {
  scene::TriangleMesh mesh;
  for (const Double3& p : points)
    for (double v : {p.x, p.y, p.z}) mesh.positions.push_back(static_cast<float>(v));
  for (uint32_t i = 0; i + 2 < points.size(); ++i)
    for (uint32_t k = 0; k < 3; ++k) mesh.indices.push_back(i + k);
  return mesh;
}

std::vector<Map> maps() {
  return {map_of(translated(0, 0, 0)),
          map_of(motion::multiply(turned({0, 1, 0}, 45), scaled(1, 1, 1))),
          map_of(motion::multiply(turned({1, 2, 3}, 70), scaled(2, -0.5, 1))),
          map_of(motion::multiply(translated(100, 20, -3), turned({1, 1, 1}, 200)))};
}

TEST(Hull, IsCloseAroundMeshesUnderMaps) {
  const std::vector<Double3> points = sphere_points({0.5, 0, 0});
  test::SceneBuilder b;
  b.shape(mesh_of(points), b.diffuse(0.5F));
  const World world(b);
  const Hull hull(world.primitives, world.primitives.world);
  EXPECT_NEAR(hull.reach(), std::hypot(1.5, 1, 1), 1e-4);
  for (const Map& map : maps()) {
    const Bounds box = hull.under(map.data());
    for (const Double3& p : points) EXPECT_LE(outside(box, mapped(map, p)), 1e-6);
    // The box of a turned box has up to three times the area.
    EXPECT_LT(area(box), 1.4 * area(around(map, points)));
  }
}

TEST(Hull, IsCloseAroundAnalyticShapesUnderMaps) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0.5, 0, 0}, 1}, b.diffuse(0.5F));
  b.shape(scene::Disk{scaled(2, 1, 1)}, 0).shape(scene::Cylinder{scaled(0.5, 1, 3)}, 0);
  const World world(b);
  std::vector<Double3> shapes[3];
  shapes[0] = sphere_points({0.5, 0, 0});
  for (int i = 0; i < 720; ++i) {
    const double phi = std::numbers::pi * i / 360;
    shapes[1].push_back({2 * std::cos(phi), std::sin(phi), 0});
    for (double z : {0.0, 3.0}) shapes[2].push_back({0.5 * std::cos(phi), std::sin(phi), z});
  }
  for (const Map& map : maps()) {
    for (uint32_t i = 0; i < 3; ++i) {
      const Bounds box = bounds_of_analytic(world.primitives, i, map.data());
      for (const Double3& p : shapes[i]) EXPECT_LE(outside(box, mapped(map, p)), 1e-5);
      EXPECT_LT(area(box), 1.01 * area(around(map, shapes[i])) + 1e-3);
    }
  }
}

TEST(Hull, OfNothingIsNowhere) {
  test::SceneBuilder b;
  b.shape(scene::Sphere{{0, 0, 0}, 1}, b.diffuse(0.5F));
  const World world(b);
  const Hull hull(world.primitives, PrimitiveRange{});
  const Bounds box = hull.under(maps()[0].data());
  EXPECT_GT(box.lower[0], box.upper[0]);
}

struct Case {
  const char* name;
  scene::Motion motion;
  size_t most;        // boxes
  double much = 1.6;  // times the area that it takes up at a time
};

std::vector<Case> cases() {
  constexpr scene::Point kY = {0, 1, 0};
  std::vector<Case> all;
  all.push_back({"Straight", {{{0, translated(-1, 0, 0)}, {1, translated(5, 0.5, 0)}}}, 2});
  all.push_back({"Growing", {{{0, scaled(0.1, 0.1, 0.1)}, {1, scaled(2, 2, 2)}}}, 2});
  all.push_back({"Turn", {{turn_key(0, kY, 0), turn_key(1, kY, 170)}}, 33});
  all.push_back({"SixTurns", {{turn_key(0, kY, 0), turn_key(1, kY, 2160)}}, 129, 2.2});
  all.push_back(
      {"TurnedAndStretched",
       {{{0, scaled(1, 2, 0.5)}, {1, motion::multiply(turned({1, 1, 0}, 170), scaled(0.5, 1, 3))}}},
       129});
  all.push_back({"Mirrored",
                 {{{0, motion::multiply(turned({1, 2, 3}, 20), scaled(-1, 2, 1))},
                   {1, motion::multiply(turned({1, 2, 3}, 150), scaled(-2, 1, 1))}}},
                 129});
  scene::Motion wavy{{}, scene::MotionPath::kCatmullRom};
  for (int i = 0; i <= 16; ++i)
    wavy.keys.push_back(turn_key(i / 16.0, kY, 25.0 * i, {4 * std::sin(0.9 * i), 0, 0}));
  all.push_back({"Wavy", wavy, 129});
  return all;
}

// What is in the boxes at a time, and the areas of both.
struct Taken {
  double taken = 0, needed = 0;
};

// points: all that matters of what moves in the world's only instance.
Taken check_boxes(const Case& c, const World& world, const std::vector<Double3>& points) {
  const Hull hull(world.primitives, world.primitives.groups[0]);
  const std::vector<Bounds> boxes = boxes_over_time(hull, world.placements, 0);
  EXPECT_GE(boxes.size(), 2U) << c.name;
  EXPECT_LE(boxes.size(), c.most) << c.name;
  Taken sum;
  double most = -1;
  for (int i = 0; i <= 997; ++i) {
    const auto time = static_cast<float>(i / 997.0);
    const double place = double(time) * double(boxes.size() - 1);
    const size_t first = std::min(static_cast<size_t>(place), boxes.size() - 2);
    const double t = place - double(first);
    const Bounds &last = boxes[first], &next = boxes[first + 1];
    Bounds box;
    for (int k = 0; k < 3; ++k) {
      box.lower[k] = static_cast<float>((1 - t) * last.lower[k] + t * next.lower[k]);
      box.upper[k] = static_cast<float>((1 - t) * last.upper[k] + t * next.upper[k]);
    }
    const Map map = world.placements.matrix_at(0, time);
    for (const Double3& p : points) most = std::max(most, outside(box, mapped(map, p)));
    sum.taken += area(box);
    sum.needed += area(around(map, points));
  }
  EXPECT_LE(most, 2e-5) << c.name;
  return sum;
}

TEST(BoxesOverTime, AreCloseAroundWhatMoves) {
  for (const Case& c : cases()) {
    const std::vector<Double3> points = sphere_points({1.5, 0, 0});
    test::SceneBuilder b;
    b.shape(mesh_of(points), b.diffuse(0.5F));
    b.description().shapes[0].motion = c.motion;
    const Taken area = check_boxes(c, World(b.take(), {0, 1}), points);
    EXPECT_LT(area.taken, c.much * area.needed) << c.name;
  }
}

// Of few vertices, each in a cell of its own, the hull is exact: nothing hides what is left out.
TEST(BoxesOverTime, HoldCornersToo) {
  std::vector<Double3> corners;
  for (double x : {0.5, 2.5})
    for (double y : {-1.0, 1.0})
      for (double z : {-1.0, 1.0}) corners.push_back({x, y, z});
  for (Case c : cases()) {
    c.most = 129;
    test::SceneBuilder b;
    b.shape(mesh_of(corners), b.diffuse(0.5F));
    b.description().shapes[0].motion = c.motion;
    check_boxes(c, World(b.take(), {0, 1}), corners);
  }
}

// A group with a matrix of its own and analytic shapes; a mesh that deforms on its way.
TEST(BoxesOverTime, HoldGroupsAndMeshesThatDeform) {
  std::vector<Double3> rims;
  for (int i = 0; i < 360; ++i) {
    const double phi = std::numbers::pi * i / 180;
    for (double z : {0.0, 3.0}) rims.push_back({0.5 * std::cos(phi), std::sin(phi), z});
    rims.push_back({2 * std::cos(phi), std::sin(phi), 0});
  }
  const std::vector<Double3> small = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  std::vector<Double3> large, both = small;
  for (const Double3& p : small) large.push_back({4 * p.x - 1, 3 * p.y, 2 * p.z - 2});
  both.insert(both.end(), large.begin(), large.end());
  for (Case c : cases()) {
    c.most = 129;
    test::SceneBuilder b;
    b.shape(scene::Disk{scaled(2, 1, 1)}, b.diffuse(0.5F));
    b.shape(scene::Cylinder{scaled(0.5, 1, 3)}, 0);
    for (scene::Shape& shape : b.description().shapes) shape.group = 0;
    b.description().instances.push_back({translated(3, -1, 0), 0, {}, c.motion});
    check_boxes(c, World(b.take(), {0, 1}), rims);

    test::SceneBuilder d;
    scene::TriangleMesh mesh = mesh_of(small);
    mesh.keys = {{mesh_of(small).positions, {}}, {mesh_of(large).positions, {}}};
    d.shape(mesh, d.diffuse(0.5F));
    d.description().shapes[0].key_times = {0, 1};
    d.description().shapes[0].motion = c.motion;
    check_boxes(c, World(d.take(), {0, 1}), both);
  }
}

}  // namespace
}  // namespace metrofarm::geometry
