// pbrt scenes that people use, if METROFARM_SHARED_SCENES names a directory that holds them; those
// that exist in Mitsuba's format as well are compared with it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <optional>

#include "pbrt_support.h"
#include "scene_file/affine.h"

namespace metrofarm::scene_file::test {
namespace {

// Nothing if the directory or the scene isn't there.
std::optional<scene::SceneDescription> load_shared(const std::string& name, bool lenient = false) {
  const char* directory = std::getenv("METROFARM_SHARED_SCENES");
  if (!directory) return std::nullopt;
  const std::filesystem::path file = std::filesystem::path(directory) / "scenes" / name;
  if (!std::filesystem::exists(file)) return std::nullopt;
  auto loaded = load_scene(file, {.lenient = lenient, .root = file.parent_path()});
  EXPECT_TRUE(loaded) << (loaded ? "" : loaded.error().to_string());
  if (!loaded) return std::nullopt;
  return std::move(loaded.value());
}

size_t triangles_of(const scene::SceneDescription& scene) {
  size_t count = 0;
  for (const scene::Shape& shape : scene.shapes) {
    const auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry);
    if (mesh) count += mesh->indices.size() / 3;
  }
  return count;
}

// The one of `a` stands `closer` ahead of that of `b`.
void expect_same_camera(const scene::SceneDescription& a, const scene::SceneDescription& b,
                        double closer = 0) {
  const Matrix moved = multiply(b.sensor.to_world, translation({0, 0, closer}));
  for (size_t i = 0; i < 16; ++i) {
    EXPECT_NEAR(a.sensor.to_world[i], moved[i], 2e-4) << "matrix element " << i;
  }
  EXPECT_NEAR(a.sensor.fov_x_degrees, b.sensor.fov_x_degrees, 1e-3);
  EXPECT_EQ(a.film.width, b.film.width);
  EXPECT_EQ(a.film.height, b.film.height);
}

struct Box {
  Point low{1e30, 1e30, 1e30}, high{-1e30, -1e30, -1e30};
};

Box bounds_of(const scene::SceneDescription& scene) {
  Box box;
  for (const scene::Shape& shape : scene.shapes) {
    const auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry);
    if (!mesh) continue;
    for (size_t i = 0; i < mesh->positions.size(); ++i) {
      box.low[i % 3] = std::min<double>(box.low[i % 3], mesh->positions[i]);
      box.high[i % 3] = std::max<double>(box.high[i % 3], mesh->positions[i]);
    }
  }
  return box;
}

void expect_same_bounds(const scene::SceneDescription& a, const scene::SceneDescription& b) {
  const Box first = bounds_of(a), second = bounds_of(b);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(first.low[i], second.low[i], 1e-3);
    EXPECT_NEAR(first.high[i], second.high[i], 1e-3);
  }
}

TEST(PbrtSharedScenes, CornellBoxes) {
  struct Case {
    const char* name;
    size_t shapes, triangles;
  };
  for (const Case& c : {Case{"pbrt-cornell/cornell-box.pbrt", 8, 32},
                        Case{"pbrt-cornell/cornell-box-specular.pbrt", 8, 22},
                        Case{"pbrt-cornell/smallpt.pbrt", 8, 10}}) {
    const auto scene = load_shared(c.name);
    if (!scene) GTEST_SKIP() << "METROFARM_SHARED_SCENES has no " << c.name;
    EXPECT_EQ(scene->shapes.size(), c.shapes) << c.name;
    EXPECT_EQ(triangles_of(*scene), c.triangles) << c.name;
    EXPECT_EQ(scene->emitters.size(), 1U);
    EXPECT_TRUE(scene->warnings.empty());
  }
}

TEST(PbrtSharedScenes, KillerooMoving) {
  const auto scene = load_shared("killeroo-moving/killeroo-moving.pbrt");
  if (!scene) GTEST_SKIP() << "METROFARM_SHARED_SCENES has no killeroo-moving";
  EXPECT_EQ(scene->shapes.size(), 5U);
  EXPECT_EQ(triangles_of(*scene) % 4, 0U);
  EXPECT_GT(triangles_of(*scene), 10000U);
}

// The files differ in the radiance of the light: 300 and 1000.
TEST(PbrtSharedScenes, VeachAjarIsItsMitsubaTwin) {
  const auto pbrt = load_shared("veach-ajar/veach-ajar.pbrt");
  const auto mitsuba = load_shared("veach-ajar/scene.xml");
  if (!pbrt || !mitsuba) GTEST_SKIP() << "METROFARM_SHARED_SCENES has no veach-ajar";
  EXPECT_EQ(pbrt->shapes.size(), mitsuba->shapes.size());
  EXPECT_EQ(triangles_of(*pbrt), triangles_of(*mitsuba));
  expect_same_bounds(*pbrt, *mitsuba);
  expect_same_camera(*pbrt, *mitsuba);
  ASSERT_EQ(pbrt->emitters.size(), 1U);
  EXPECT_EQ(std::get<scene::AreaEmitter>(pbrt->emitters[0].model).radiance.value,
            (scene::Rgb{300, 300, 300}));
}

TEST(PbrtSharedScenes, VolumetricCausticIsItsMitsubaTwinWithoutMedium) {
  const auto pbrt = load_shared("volumetric-caustic/volumetric-caustic.pbrt", true);
  const auto mitsuba = load_shared("volumetric-caustic/scene.xml", true);
  if (!pbrt || !mitsuba) GTEST_SKIP() << "METROFARM_SHARED_SCENES has no volumetric-caustic";
  EXPECT_EQ(pbrt->shapes.size(), mitsuba->shapes.size());
  EXPECT_EQ(triangles_of(*pbrt), triangles_of(*mitsuba));
  expect_same_bounds(*pbrt, *mitsuba);
  expect_same_camera(*pbrt, *mitsuba, 0.2);  // the files say 6.8 and 7
  ASSERT_EQ(pbrt->emitters.size(), 1U);
  ASSERT_EQ(mitsuba->emitters.size(), 1U);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(std::get<scene::AreaEmitter>(pbrt->emitters[0].model).radiance.value[i],
                std::get<scene::AreaEmitter>(mitsuba->emitters[0].model).radiance.value[i], 1);
  }
}

TEST(PbrtSharedScenes, MediaAreRefusedWithTheirLine) {
  const char* directory = std::getenv("METROFARM_SHARED_SCENES");
  if (!directory) GTEST_SKIP() << "METROFARM_SHARED_SCENES is not set";
  const auto file =
      std::filesystem::path(directory) / "scenes/volumetric-caustic/" / "volumetric-caustic.pbrt";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " does not exist";
  const auto scene = load_scene(file, {});
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().where.line, 25);
  EXPECT_NE(scene.error().message.find("participating media"), std::string::npos);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
