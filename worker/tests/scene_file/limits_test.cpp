// What a scene may take: memory in proportion to its files, time in proportion to its meshes, and
// no more than the renderer can number.
#include "scene_file/limits.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <ctime>
#include <functional>
#include <numbers>
#include <string>

#include "pbrt_support.h"
#include "scene_file/mesh.h"
#include "scene_file/obj.h"
#include "scene_file/pbrt/loop_subdivision.h"
#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

constexpr const char* kOneTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

// Positions and indices of 12 and normals of 36 bytes: 84 in all.
std::string shapes(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) {
    text += "<shape type=\"obj\"><string name=\"filename\" value=\"m.obj\"/></shape>\n";
  }
  return text;
}

TEST(MemoryBudget, CountsEveryCopyOfAMesh) {
  const Directory directory;
  directory.write("m.obj", kOneTriangle);
  LoadOptions options;
  options.max_bytes = 3 * sizeof(scene::Shape) + 2 * 84;
  EXPECT_EQ(error_of(directory, shapes(2), options), "");
  EXPECT_EQ(error_of(directory, shapes(3), options),
            "m.obj: with it the shapes and images of the scene take more than the " +
                std::to_string(options.max_bytes) +
                " bytes of memory that are allowed (read for the shape at scene.xml:4)");
}

// Each line doubles what the one before stands for.
std::string doublings(const std::string& first, int lines) {
  std::string text = "<shape type=\"merge\" id=\"m0\">" + first + "</shape>\n";
  for (int i = 1; i <= lines; ++i) {
    const std::string half = "<ref id=\"m" + std::to_string(i - 1) + "\" name=\"";
    text += "<shape type=\"merge\" id=\"m" + std::to_string(i) + "\">" + half + "a\"/>" + half +
            "b\"/></shape>\n";
  }
  return text;
}

TEST(MemoryBudget, CountsShapesAndInstances) {
  LoadOptions options;
  options.max_bytes = uint64_t{1} << 20;
  const std::string sphere = "<shape type=\"sphere\"/>";
  const std::string instance = "<shape type=\"instance\"><ref id=\"group\"/></shape>";
  const std::string group = "<shape type=\"shapegroup\" id=\"group\">" + sphere + "</shape>\n";
  for (const std::string& text : {doublings(sphere, 15), group + doublings(instance, 15)}) {
    EXPECT_NE(error_of(text, options).find("more than the 1048576 bytes"), std::string::npos);
  }
}

TEST(MemoryBudget, CountsTheImagesOfSkies) {
  const std::string sky = "<emitter type=\"sunsky\"/>";
  LoadOptions options;
  options.max_bytes = 1000;
  EXPECT_NE(error_of(sky, options).find("more than the 1000 bytes"), std::string::npos);
}

// A face of 2 bytes per corner whose attributes every one of its triangles gets.
TEST(MemoryBudget, LimitsPolygonsWithAttributes) {
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list ushort uchar vertex_indices\n";
  for (char name = 'a'; name <= 'z'; ++name) file += std::string("property char ") + name + "_x\n";
  file += "end_header\n" + std::string(36, '\0') + std::string("\x00\x10", 2);
  file += std::string(4096 + 26, '\0');
  const Directory directory;
  directory.write("m.ply", file);
  LoadOptions options;
  options.max_bytes = 400000;
  const std::string shape =
      "<shape type=\"ply\"><string name=\"filename\" value=\"m.ply\"/></shape>";
  EXPECT_EQ(error_of(directory, shape, options).substr(0, 35),
            "m.ply: the faces take more than the");
  options.max_bytes = 600000;
  EXPECT_EQ(error_of(directory, shape, options), "");
}

std::string gzipped(const std::string& text) {
  std::string result(text.size() + 1000, '\0');
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(result.data());
  stream.avail_out = static_cast<uInt>(result.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  result.resize(stream.total_out);
  deflateEnd(&stream);
  return result;
}

TEST(MemoryBudget, LimitsWhatAGzipFileHolds) {
  const Directory directory;
  directory.write("m.ply.gz", gzipped("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                                      "property float y\nproperty float z\nelement face 1\n"
                                      "property list uchar int vertex_indices\nend_header\n"
                                      "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n" +
                                      std::string(size_t{3} << 20, '\n')));
  const std::string world =
      pbrt_around("Shape \"plymesh\" \"string filename\" \"m.ply.gz\" LightSource \"infinite\"");
  LoadOptions options;
  options.max_bytes = uint64_t{4} << 20;
  const auto fits = load_pbrt(directory, world, options);
  EXPECT_TRUE(fits) << fits.error().to_string();
  options.max_bytes = uint64_t{2} << 20;
  const auto refused = load_pbrt(directory, world, options);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("holds more than 2097152 bytes"), std::string::npos)
      << refused.error().message;
}

// ---- time ----

double seconds_of(const std::function<void()>& work) {
  const std::clock_t start = std::clock();
  work();
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

// Around the vertex 0, flat (and tilted, so that rounding shows) or (as an open parasol) each
// triangle in a plane of its own.
RawMesh fan(uint32_t triangles, double height) {
  RawMesh mesh;
  mesh.positions = {0, 0, 0};
  for (uint32_t i = 0; i <= triangles; ++i) {
    const double angle = 2 * std::numbers::pi * i / triangles;
    for (double v : {std::cos(angle), std::sin(angle), std::cos(angle) / 3 - height}) {
      mesh.positions.push_back(static_cast<float>(v));
    }
    if (i > 0) mesh.indices.insert(mesh.indices.end(), {0, i, i + 1});
  }
  return mesh;
}

// Quadratic work took more than a minute each.
TEST(Time, IsLinearInTheTrianglesAroundAVertex) {
  for (double height : {0.0, 1.0}) {
    EXPECT_LT(seconds_of([&] {
                const auto mesh = finish_mesh(fan(400000, height), {.max_smooth_angle = 30});
                ASSERT_TRUE(mesh) << mesh.error().message;
              }),
              10);
  }
  EXPECT_LT(seconds_of([] {
              const RawMesh open = fan(400000, 1);
              const auto surface = pbrt::subdivide(
                  {{open.positions.begin(), open.positions.end()}, {}, open.indices}, 0);
              ASSERT_TRUE(surface) << surface.error().message;
            }),
            10);
}

TEST(Time, IsLinearInTheCornersAtAPosition) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  constexpr int kCorners = 300000;
  for (int i = 0; i < kCorners; ++i) text += "vt 0 0\n";
  for (int i = 1; i <= kCorners; ++i) text += "f 1/" + std::to_string(i) + " 2/1 3/1\n";
  EXPECT_LT(seconds_of([&] {
              const auto mesh = parse_obj(text, "m.obj");
              ASSERT_TRUE(mesh);
              EXPECT_EQ(mesh.value().vertex_count(), kCorners + 2U);
            }),
            10);
}

// ---- the renderer's limits ----

scene::Shape mesh_shape(size_t triangles, float far) {
  scene::TriangleMesh mesh;
  mesh.positions = {0, 0, 0, 1, 0, 0, 0, far, 0};
  mesh.indices.assign(3 * triangles, 0);
  scene::Shape shape;
  shape.geometry = std::move(mesh);
  shape.where = {"scene.xml", 7};
  return shape;
}

std::string limit_error(scene::SceneDescription scene) {
  const auto error = check_limits(scene);
  return error ? error->to_string() : "";
}

TEST(Limits, LightsAreNumberedBySteps) {
  scene::SceneDescription scene;
  scene.shapes.push_back(mesh_shape((size_t{1} << 22) - 1, 1));
  EXPECT_EQ(limit_error(scene), "");
  scene.shapes[0].area_emitter = 0;
  scene.emitters.push_back({scene::AreaEmitter{}, {}});
  EXPECT_EQ(limit_error(scene), "");
  scene.emitters.push_back({scene::PointEmitter{}, {"scene.xml", 9}});
  EXPECT_EQ(limit_error(scene),
            "scene.xml:9: with this the scene has 4194304 lights (a mesh counts by its triangles); "
            "at most 4194303 can be rendered");
}

TEST(Limits, NothingReachesFurtherThanEmbreeSees) {
  scene::SceneDescription scene;
  scene.shapes.push_back(mesh_shape(1, 1.79e18F));
  EXPECT_EQ(limit_error(scene), "");
  scene.shapes[0] = mesh_shape(1, 1.81e18F);
  EXPECT_EQ(limit_error(scene),
            "scene.xml:7: the shape reaches beyond 1.8e18 from the origin, where nothing can be "
            "rendered; use a smaller unit of length");
  scene.shapes[0].geometry = scene::Sphere{.center = {1e18, 0, 0}, .radius = 1e18};
  EXPECT_NE(limit_error(scene), "");
  scene.shapes[0] = mesh_shape(1, 1e18F);
  scene.shapes[0].group = 0;
  scene::Instance instance;
  instance.group = 0;
  instance.where = {"scene.xml", 8};
  scene.instances.push_back(instance);
  EXPECT_EQ(limit_error(scene), "");
  scene.instances[0].to_world[3] = 1;
  scene.instances[0].to_world[5] = 2;
  EXPECT_EQ(limit_error(scene).substr(0, 46), "scene.xml:8: the instance reaches beyond 1.8e1");
}

scene::Motion bent_way(scene::MotionPath path, const Point& out) {
  scene::Motion motion;
  motion.path = path;
  motion.keys.resize(2);
  motion.keys[1].time = 1;
  motion.keys[0].out = out;
  return motion;
}

TEST(Limits, ControlPointsCount) {
  using scene::MotionPath;
  const Point far = {1e200, 0, 0};
  const std::string beyond = "reaches beyond 1.8e18";
  scene::SceneDescription scene;
  scene.shapes.push_back(mesh_shape(1, 1));
  scene.shapes[0].motion = bent_way(MotionPath::kBezier, {1, 0, 0});
  EXPECT_EQ(limit_error(scene), "");
  scene.shapes[0].motion = bent_way(MotionPath::kBezier, far);
  EXPECT_NE(limit_error(scene).find("scene.xml:7: the shape " + beyond), std::string::npos);
  scene.shapes[0].motion = bent_way(MotionPath::kLinear, far);
  EXPECT_EQ(limit_error(scene), "") << "of straight ways they mean nothing";
  scene.shapes[0].motion = {};
  scene.sensor.where = {"scene.xml", 3};
  scene.sensor.motion = bent_way(MotionPath::kBezier, far);
  EXPECT_NE(limit_error(scene).find("scene.xml:3: the way of the sensor " + beyond),
            std::string::npos);
  scene.sensor.motion = {};
  scene.emitters.push_back(
      {scene::PointEmitter{}, {"scene.xml", 4}, bent_way(MotionPath::kBezier, far)});
  EXPECT_NE(limit_error(scene).find("scene.xml:4: the light " + beyond), std::string::npos);
}

// Two keys so close in time make a slope without bounds.
TEST(Limits, SmoothWaysDoNotSwingBeyondThem) {
  for (double near : {1e-30, 1e-310}) {
    scene::SceneDescription scene;
    scene.shapes.push_back(mesh_shape(1, 1));
    scene::Motion motion;
    motion.path = scene::MotionPath::kCatmullRom;
    motion.keys.resize(3);
    motion.keys[1].time = near;
    motion.keys[1].to_world[3] = 1;
    motion.keys[2].time = 1;
    scene.shapes[0].motion = motion;
    EXPECT_NE(limit_error(scene).find("scene.xml:7: the shape reaches beyond"), std::string::npos)
        << near;
  }
}

TEST(Limits, HoldForEveryImporter) {
  EXPECT_NE(error_of("<shape type=\"sphere\"><float name=\"radius\" value=\"2e18\"/></shape>")
                .find("scene.xml:2: the shape reaches beyond"),
            std::string::npos);
  EXPECT_NE(pbrt_error(pbrt_around("Shape \"sphere\" \"float radius\" 2e18"))
                .find("scene.pbrt:2: the shape reaches beyond"),
            std::string::npos);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
