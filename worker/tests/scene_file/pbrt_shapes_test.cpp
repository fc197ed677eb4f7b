// Shapes of pbrt scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pbrt_support.h"
#include "scene_file/affine.h"
#include "scene_file/pbrt/loop_subdivision.h"

namespace metrofarm::scene_file::test {
namespace {

using pbrt::subdivide;
using pbrt::SubdivisionMesh;

constexpr std::string_view kTriangle = "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] ";

Point vertex(const scene::TriangleMesh& mesh, size_t corner) {
  const float* p = &mesh.positions[3 * size_t{mesh.indices[corner]}];
  return {p[0], p[1], p[2]};
}

// Of the first triangle, by its winding.
Point normal_of(const scene::TriangleMesh& mesh) {
  const Point origin = vertex(mesh, 0);
  return normalized(cross(subtract(vertex(mesh, 1), origin), subtract(vertex(mesh, 2), origin)));
}

TEST(PbrtShapes, MeshesWithoutNormalsAreFlatAndKeepTheirOutside) {
  const auto plain = valid_pbrt(kTriangle);
  EXPECT_TRUE(first_mesh(plain).normals.empty());
  EXPECT_NEAR(normal_of(first_mesh(plain))[2], 1, 1e-6);
  // Mirrored in x: the transformed normal is still +z.
  const auto mirrored = valid_pbrt("Scale -1 1 1 " + std::string(kTriangle));
  EXPECT_NEAR(normal_of(first_mesh(mirrored))[2], 1, 1e-6);
  EXPECT_FALSE(mirrored.shapes[0].flip_normals);
}

TEST(PbrtShapes, TheWindingFollowsGivenNormals) {
  const auto scene = valid_pbrt(std::string(kTriangle) +
                                "\"normal N\" [0 0 -1 0 0 -1 0 0 -1] \"point2 uv\" "
                                "[0 0 1 0 0 1]");
  EXPECT_NEAR(normal_of(first_mesh(scene))[2], -1, 1e-6);
  EXPECT_EQ(first_mesh(scene).texcoords, (std::vector<float>{0, 0, 1, 0, 0, 1}));
}

TEST(PbrtShapes, BilinearPatchesBecomeTwoTriangles) {
  const auto scene = valid_pbrt("Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]");
  EXPECT_EQ(first_mesh(scene).indices.size(), 6U);
  EXPECT_EQ(first_mesh(scene).texcoords, (std::vector<float>{0, 0, 1, 0, 0, 1, 1, 1}));
  EXPECT_NEAR(normal_of(first_mesh(scene))[2], 1, 1e-6);
  EXPECT_NE(pbrt_error(pbrt_around("Shape \"bilinearmesh\" \"point3 P\" "
                                   "[0 0 0 1 0 0 0 1 0 1 1 1]"))
                .find("curved bilinear patches"),
            std::string::npos);
}

TEST(PbrtShapes, QuadricsAreWholeAndFlipUnderMirrors) {
  const auto scene = valid_pbrt(
      "Scale -2 2 2 Shape \"sphere\" \"float radius\" 3 Shape \"disk\" \"float height\" 1 "
      "Shape \"cylinder\" \"float zmin\" -2 \"float zmax\" 1");
  EXPECT_EQ(std::get<scene::Sphere>(scene.shapes[0].geometry).radius, 6);
  const Matrix& disk = std::get<scene::Disk>(scene.shapes[1].geometry).to_world;
  EXPECT_EQ(disk[11], 2);
  const Matrix& cylinder = std::get<scene::Cylinder>(scene.shapes[2].geometry).to_world;
  EXPECT_EQ(transform_point(cylinder, {0, 0, 0})[2], -4);
  EXPECT_EQ(transform_point(cylinder, {0, 0, 1})[2], 2);
  for (const scene::Shape& shape : scene.shapes) EXPECT_TRUE(shape.flip_normals);
  // The frames are not mirrored: only the coordinates on the surface are.
  EXPECT_GT(determinant(disk), 0);
  EXPECT_GT(determinant(cylinder), 0);
}

// What follows makes a thing move a little, and leaves both transforms active.
constexpr std::string_view kMove = "ActiveTransform EndTime Translate 1 0 0 ActiveTransform All ";

TEST(PbrtShapes, MirrorsTurnWhatMovesAsWhatStands) {
  for (const std::string& shape :
       {std::string(kTriangle), std::string(kTriangle) + "\"normal N\" [0 0 1 0 0 1 0 0 1]",
        std::string("Shape \"sphere\""), std::string("Shape \"disk\""),
        std::string("Shape \"cylinder\"")}) {
    for (const char* turn : {"", "ReverseOrientation "}) {
      const std::string before = std::string(turn) + "Scale -1 1 1 ";
      const auto still = valid_pbrt(before + shape);
      const auto moving = valid_pbrt(before + std::string(kMove) + shape);
      ASSERT_EQ(moving.shapes.at(0).motion.keys.size(), 2U) << shape;
      EXPECT_EQ(moving.shapes[0].flip_normals, still.shapes.at(0).flip_normals) << before << shape;
    }
  }
}

TEST(PbrtShapes, TwoSidedLightsThatAMirrorMovesShineOutwards) {
  for (const std::string& before : {std::string(), std::string("Scale -1 1 1 ")}) {
    const auto scene = valid_pbrt(before + std::string(kMove) +
                                  "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] "
                                  "\"bool twosided\" true Shape \"sphere\"");
    ASSERT_EQ(scene.shapes.size(), 2U);
    for (size_t i = 0; i < 2; ++i) {
      const double own = std::get<scene::Sphere>(scene.shapes[i].geometry).radius;
      const double other = std::get<scene::Sphere>(scene.shapes[1 - i].geometry).radius;
      EXPECT_EQ(own > other, !scene.shapes[i].flip_normals) << before << "the larger outwards";
    }
  }
}

TEST(PbrtShapes, PartsOfQuadricsAreRefused) {
  for (const char* shape :
       {"Shape \"sphere\" \"float zmin\" 0", "Shape \"sphere\" \"float phimax\" 90",
        "Shape \"disk\" \"float innerradius\" 0.5", "Shape \"cylinder\" \"float phimax\" 180"}) {
    EXPECT_NE(pbrt_error(pbrt_around(shape)).find("only whole"), std::string::npos) << shape;
  }
  EXPECT_NE(pbrt_error(pbrt_around("Scale 1 2 1 Shape \"sphere\"")).find("ellipsoid"),
            std::string::npos);
}

TEST(PbrtShapes, WrongMeshesAreRefused) {
  for (const char* shape : {
           "Shape \"trianglemesh\"",
           "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1]",
           "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 3]",
           "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 -1]",
           "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 "
           "47777777777777777777]",
           "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"normal N\" [0 0 1]",
           "Shape \"plymesh\" \"string filename\" \"missing.ply\"",
           "Shape \"plymesh\"",
           "Shape \"loopsubdiv\" \"point3 P\" [0 0 0 1 0 0] \"integer indices\" [0 1 2]",
       }) {
    EXPECT_NE(pbrt_error(pbrt_around(shape)), "") << shape;
  }
}

TEST(PbrtShapes, PlyFilesAreRead) {
  const Directory directory;
  directory.write("m.ply",
                  "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
                  "y\nproperty float z\nelement face 1\nproperty list uchar int "
                  "vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  const auto scene =
      load_pbrt(directory, pbrt_around("Shape \"plymesh\" \"string filename\" \"m.ply\""));
  ASSERT_TRUE(scene) << scene.error().to_string();
  EXPECT_EQ(first_mesh(scene.value()).indices.size(), 3U);
  EXPECT_TRUE(first_mesh(scene.value()).normals.empty());
}

SubdivisionMesh octahedron() {
  return {{1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1},
          {},
          {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5}};
}

// A vertex of valence 4 goes to the limit (1 - 4 g) p + g (sum of neighbours), g = 1 / (4 + 3 /
// (8 beta)) with beta = 3/32: here the neighbours cancel.
TEST(PbrtLoopSubdivision, LevelZeroIsTheControlMeshOnTheLimitSurface) {
  const auto surface = subdivide(octahedron(), 0);
  ASSERT_TRUE(surface);
  EXPECT_EQ(surface.value().indices, octahedron().indices);
  EXPECT_NEAR(surface.value().positions[0], 0.5, 1e-12);
}

TEST(PbrtLoopSubdivision, RefinementKeepsTheLimitSurface) {
  const auto coarse = subdivide(octahedron(), 0);
  const auto fine = subdivide(octahedron(), 3);
  ASSERT_TRUE(coarse && fine);
  EXPECT_EQ(fine.value().indices.size(), 64 * coarse.value().indices.size());
  for (size_t i = 0; i < coarse.value().positions.size(); ++i) {
    EXPECT_NEAR(fine.value().positions[i], coarse.value().positions[i], 1e-12);
    EXPECT_NEAR(fine.value().normals[i], coarse.value().normals[i], 1e-9);
  }
}

// pbrt walks around a vertex clockwise, so its normals of a counter-clockwise mesh point inwards.
TEST(PbrtLoopSubdivision, NormalsPointInwardsAsInPbrt) {
  const auto surface = subdivide(octahedron(), 2);
  ASSERT_TRUE(surface);
  const SubdivisionMesh& mesh = surface.value();
  for (size_t i = 0; i < mesh.vertex_count(); ++i) {
    double along = 0;
    for (size_t axis = 0; axis < 3; ++axis) {
      along += mesh.positions[3 * i + axis] * mesh.normals[3 * i + axis];
    }
    EXPECT_LT(along, 0);
  }
}

// A flat sheet stays flat; its boundary is the cubic spline of its corners, in its plane.
TEST(PbrtLoopSubdivision, BoundariesStayInTheirPlane) {
  SubdivisionMesh fan{{0, 0, 0}, {}, {}};
  constexpr int kRim = 6;
  for (int i = 0; i < kRim; ++i) {
    const double angle = i * std::numbers::pi / 5;
    fan.positions.insert(fan.positions.end(), {std::cos(angle), std::sin(angle), 0});
    if (i > 0) {
      fan.indices.insert(fan.indices.end(),
                         {0, static_cast<uint32_t>(i), static_cast<uint32_t>(i + 1)});
    }
  }
  const auto surface = subdivide(fan, 3);
  ASSERT_TRUE(surface) << surface.error().message;
  for (size_t i = 0; i < surface.value().vertex_count(); ++i) {
    EXPECT_EQ(surface.value().positions[3 * i + 2], 0);
    EXPECT_NEAR(surface.value().normals[3 * i + 2], -1, 1e-9);
  }
}

TEST(PbrtLoopSubdivision, WhatIsNoManifoldIsRefused) {
  // Three triangles at an edge; two triangles of opposite orientation; two fans at a vertex.
  const std::vector<double> points = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, -1, 0};
  EXPECT_FALSE(subdivide({points, {}, {0, 1, 2, 0, 1, 3, 0, 1, 4}}, 1));
  EXPECT_FALSE(subdivide({points, {}, {0, 1, 2, 0, 1, 3}}, 1));
  EXPECT_FALSE(subdivide({points, {}, {0, 1, 2, 0, 3, 4}}, 1));
  EXPECT_FALSE(subdivide({points, {}, {0, 0, 1}}, 1));
  EXPECT_FALSE(subdivide(octahedron(), 40));
}

}  // namespace
}  // namespace metrofarm::scene_file::test
