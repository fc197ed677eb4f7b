// Scenes that people use, if METROFARM_SHARED_SCENES names a directory that holds them; searched
// below it as NAME/scene.xml. Numbers were read from Mitsuba 3.9.1.
#include <gtest/gtest.h>

#include <cstdlib>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

struct SharedScene {
  const char* file;
  size_t shapes;
  size_t triangles;
  size_t emitters;
  double fov_x;
};

void PrintTo(const SharedScene& scene, std::ostream* out) {
  *out << scene.file;
}

class SharedScenes : public testing::TestWithParam<SharedScene> {};

TEST_P(SharedScenes, Load) {
  const char* directory = std::getenv("METROFARM_SHARED_SCENES");
  if (!directory) GTEST_SKIP() << "METROFARM_SHARED_SCENES is not set";
  const std::filesystem::path file = std::filesystem::path(directory) / GetParam().file;
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " does not exist";
  const auto loaded = load_scene(file, {.root = file.parent_path()});
  ASSERT_TRUE(loaded) << loaded.error().to_string();
  const scene::SceneDescription& scene = loaded.value();
  size_t triangles = 0;
  for (const scene::Shape& shape : scene.shapes) {
    const auto* mesh = std::get_if<scene::TriangleMesh>(&shape.geometry);
    if (mesh) triangles += mesh->indices.size() / 3;
  }
  EXPECT_EQ(scene.shapes.size(), GetParam().shapes);
  EXPECT_EQ(triangles, GetParam().triangles);
  EXPECT_EQ(scene.emitters.size(), GetParam().emitters);
  EXPECT_NEAR(scene.sensor.fov_x_degrees, GetParam().fov_x, 1e-4);
  EXPECT_TRUE(scene.warnings.empty());
}

INSTANTIATE_TEST_SUITE_P(
    All, SharedScenes,
    testing::Values(SharedScene{"scenes/cornell-box/scene.xml", 8, 36, 1, 19.5},
                    SharedScene{"scenes/cornell-box/scene_v0.6.xml", 8, 36, 1, 19.5},
                    SharedScene{"scenes/veach-mis/scene.xml", 9, 52, 3, 35},
                    SharedScene{"scenes/veach-bidir/scene.xml", 14, 11544, 2, 35},
                    SharedScene{"scenes/mitsuba-cbox/cbox-rgb.xml", 8, 38, 1, 39.3077},
                    SharedScene{"peers/scenes/cornell-diffuse/scene.xml", 8, 36, 1, 39},
                    SharedScene{"peers/scenes/veach-door/scene.xml", 24, 2404, 1, 62},
                    SharedScene{"peers/scenes/veach-mis/scene.xml", 10, 52, 5, 30}));

}  // namespace
}  // namespace metrofarm::scene_file::test
