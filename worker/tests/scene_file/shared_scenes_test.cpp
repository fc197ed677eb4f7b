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
  size_t textures;
  double fov_x;
  size_t warnings = 0;
  bool media = false;  // refused unless lenient
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
  LoadOptions options = {.root = directory};
  if (GetParam().media) {
    const auto refused = load_scene(file, options);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().message, "participating media are not supported");
    EXPECT_GT(refused.error().where.line, 0);
    options.lenient = true;
  }
  const auto loaded = load_scene(file, options);
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
  EXPECT_EQ(scene.textures.size(), GetParam().textures);
  EXPECT_NEAR(scene.sensor.fov_x_degrees, GetParam().fov_x, 1e-4);
  EXPECT_EQ(scene.warnings.size(), GetParam().warnings);
}

INSTANTIATE_TEST_SUITE_P(
    All, SharedScenes,
    testing::Values(SharedScene{"scenes/classroom/scene.xml", 79, 103832, 1, 3, 60, 1},
                    SharedScene{"scenes/classroom/scene_v0.6.xml", 79, 103832, 1, 3, 60, 1},
                    SharedScene{"scenes/cornell-box/scene.xml", 8, 36, 1, 0, 19.5},
                    SharedScene{"scenes/cornell-box/scene_v0.6.xml", 8, 36, 1, 0, 19.5},
                    SharedScene{"scenes/cornell-box-motion/scene.xml", 7, 34, 1, 0, 19.5},
                    SharedScene{"scenes/mitsuba-cbox/cbox.xml", 8, 38, 1, 0, 39.3077},
                    SharedScene{"scenes/mitsuba-cbox/cbox-rgb.xml", 8, 38, 1, 0, 39.3077},
                    SharedScene{"scenes/mitsuba-cbox/cbox-spectral.xml", 8, 38, 1, 0, 39.3077},
                    SharedScene{"scenes/staircase/scene.xml", 775, 262663, 1, 10, 35},
                    SharedScene{"scenes/staircase2/scene.xml", 32, 30927, 13, 3, 70},
                    SharedScene{"scenes/torus/scene.xml", 5, 23614, 1, 1, 34.6222},
                    SharedScene{"scenes/veach-ajar/scene.xml", 22, 382690, 1, 4, 60},
                    SharedScene{"scenes/veach-ajar/scene_v0.6.xml", 22, 382690, 1, 4, 60},
                    SharedScene{"scenes/veach-bidir/scene.xml", 14, 11544, 2, 0, 35},
                    SharedScene{"scenes/veach-bidir/scene_v0.6.xml", 14, 11544, 2, 0, 35},
                    SharedScene{"scenes/veach-mis/scene.xml", 9, 52, 3, 0, 35},
                    SharedScene{"scenes/veach-mis/scene_v0.6.xml", 9, 52, 3, 0, 35},
                    SharedScene{"scenes/volumetric-caustic/scene.xml", 8, 14, 1, 0, 19.5, 3, true},
                    SharedScene{"scenes/volumetric-caustic/scene_v0.6.xml", 8, 14, 1, 0, 19.5, 3,
                                true},
                    SharedScene{"peers/scenes/cornell-diffuse/scene.xml", 8, 36, 1, 0, 39},
                    SharedScene{"peers/scenes/veach-door/scene.xml", 24, 2404, 1, 0, 62},
                    SharedScene{"peers/scenes/veach-mis/scene.xml", 10, 52, 5, 0, 30}));

std::string mitsuba_test(const std::string& name) {
  return "scenes/mitsuba-tests/tests/scenes/" + name + ".xml";
}

// Kept apart, so that the names are made once.
const std::string kMitsubaTests[] = {mitsuba_test("bsdf_spheres/test_arealight_path"),
                                     mitsuba_test("bsdf_spheres/test_constant_path"),
                                     mitsuba_test("bsdf_spheres/test_pointlight_path"),
                                     mitsuba_test("floating_sphere/test_directional_direct"),
                                     mitsuba_test("instancing/test_instancing_path"),
                                     mitsuba_test("orthographic_sensor/test_orthographic_path"),
                                     mitsuba_test("spot_light/test_spot_direct"),
                                     mitsuba_test("texture_interp/test_texture_interp_direct")};

INSTANTIATE_TEST_SUITE_P(
    MitsubaTests, SharedScenes,
    testing::Values(SharedScene{kMitsubaTests[0].c_str(), 13, 325126, 1, 3, 34.022143},
                    SharedScene{kMitsubaTests[1].c_str(), 12, 325124, 1, 3, 34.022143},
                    SharedScene{kMitsubaTests[2].c_str(), 12, 325124, 1, 3, 34.022143},
                    SharedScene{kMitsubaTests[3].c_str(), 2, 32514, 1, 0, 34.022143},
                    SharedScene{kMitsubaTests[4].c_str(), 3, 32514, 1, 0, 34.022143},
                    SharedScene{kMitsubaTests[5].c_str(), 1, 2, 1, 1, 90},
                    SharedScene{kMitsubaTests[6].c_str(), 1, 2, 2, 1, 50},
                    SharedScene{kMitsubaTests[7].c_str(), 6, 12, 1, 6, 45}));

}  // namespace
}  // namespace metrofarm::scene_file::test
