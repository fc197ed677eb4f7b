// Lights that are not part of a shape.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

template <class Model>
Model load_light(const std::string& type, const std::string& content) {
  const auto scene =
      load_valid("<emitter type=\"" + type + "\">" + content + "</emitter>", {.lenient = true});
  const auto* model =
      scene.emitters.empty() ? nullptr : std::get_if<Model>(&scene.emitters[0].model);
  EXPECT_NE(model, nullptr);
  return model ? *model : Model{};
}

TEST(Spot, BeamIsThreeQuartersOfTheConeUnlessGiven) {
  const auto light = load_light<scene::SpotEmitter>(
      "spot", "<float name=\"cutoff_angle\" value=\"40\"/><rgb name=\"intensity\" value=\"2\"/>");
  EXPECT_EQ(light.cutoff_degrees, 40);
  EXPECT_EQ(light.beam_width_degrees, 30);
  EXPECT_EQ(light.intensity.value[0], 2);
  EXPECT_EQ(
      error_of("<emitter type=\"spot\">\n<float name=\"beam_width\" value=\"21\"/></emitter>"),
      "scene.xml:3: beam_width must lie between 0 and cutoff_angle");
}

TEST(Directional, TakesADirectionOrATransform) {
  const auto given = load_light<scene::DirectionalEmitter>(
      "directional", "<vector name=\"direction\" x=\"0\" y=\"-1\" z=\"0\"/>");
  EXPECT_EQ(given.direction, (scene::Point{0, -1, 0}));
  const auto turned = load_light<scene::DirectionalEmitter>(
      "directional",
      "<transform name=\"to_world\"><lookat origin=\"1,0,0\" target=\"5,0,0\" up=\"0,1,0\"/>"
      "</transform>");
  EXPECT_EQ(turned.direction, (scene::Point{1, 0, 0}));
}

TEST(Environments, OnlyOneIsAllowed) {
  EXPECT_EQ(error_of("<emitter type=\"constant\"/>\n<emitter type=\"sky\"/>"),
            "scene.xml:3: a scene can have only one environment emitter");
}

TEST(Projector, HasTheAspectOfItsImage) {
  const auto light = load_light<scene::ProjectorEmitter>(
      "projector", "<float name=\"fov\" value=\"30\"/><float name=\"scale\" value=\"4\"/>");
  EXPECT_EQ(light.aspect, 1);
  EXPECT_EQ(light.fov_x_degrees, 30);
  EXPECT_EQ(light.irradiance.value[0], 4);
}

// The radiance of the pixel that shows the direction (z up).
std::array<float, 3> radiance(const scene::Image& image, double x, double y, double z) {
  const double length = std::hypot(x, y, z);
  double turn = std::atan2(x, y) / (2 * std::numbers::pi);
  if (turn < 0) turn += 1;
  const auto column = static_cast<size_t>(turn * image.width);
  const double v = std::acos(z / length) / std::numbers::pi;
  const auto row = static_cast<size_t>(std::lround(v * (image.height - 1)));
  const auto& pixels = std::get<std::vector<float>>(image.pixels);
  const size_t i = 3 * (row * image.width + column);
  return {pixels.at(i), pixels.at(i + 1), pixels.at(i + 2)};
}

scene::Image sky_image(const std::string& content) {
  const auto scene = load_valid("<emitter type=\"sunsky\">" + content + "</emitter>");
  return scene.images.empty() ? scene::Image{} : scene.images[0];
}

const std::string kSun = "<vector name=\"sun_direction\" value=\"0, 0.87758256, 0.47942554\"/>";

// Values of Mitsuba 3.9.1's sunsky for turbidity 3 and a sun at 0.5 radians; pixels are 0.35
// degrees wide, hence the tolerance.
TEST(Sky, IsMitsubas) {
  const scene::Image image = sky_image(kSun + "<float name=\"sun_scale\" value=\"0\"/>");
  const auto zenith = radiance(image, 0, 0, 1);
  EXPECT_NEAR(zenith[0], 0.01584935, 2e-4);
  EXPECT_NEAR(zenith[1], 0.03042689, 4e-4);
  EXPECT_NEAR(zenith[2], 0.06052259, 8e-4);
  const auto side = radiance(image, 0.6, 0, 0.8);
  EXPECT_NEAR(side[0], 0.02137612, 3e-4);
  EXPECT_NEAR(side[2], 0.07458979, 1e-3);
  EXPECT_EQ(radiance(image, 0.8, 0, -0.6)[0], 0);
}

// However small the sun is, it gives the irradiance of its radiance times its solid angle.
TEST(Sun, IrradianceDoesNotDependOnItsSize) {
  const auto irradiance = [](const std::string& aperture) {
    const scene::Image image = sky_image(
        kSun + "<float name=\"sky_scale\" value=\"0\"/><float name=\"sun_aperture\" value=\"" +
        aperture + "\"/>");
    const auto& pixels = std::get<std::vector<float>>(image.pixels);
    // The image is bilinear: rows are sums over their columns, linear in between.
    std::vector<double> rows(static_cast<size_t>(image.height), 0.0);
    for (size_t i = 0; i < pixels.size(); i += 3) {
      rows[i / 3 / static_cast<size_t>(image.width)] += pixels[i];
    }
    constexpr int kSteps = 20;  // per row
    const double step = std::numbers::pi / (image.height - 1) / kSteps;
    double sum = 0;
    for (int i = 0; i < (image.height - 1) * kSteps; ++i) {
      const double place = (i + 0.5) / kSteps;
      const auto row = static_cast<size_t>(place);
      const double value = std::lerp(rows[row], rows[row + 1], place - static_cast<double>(row));
      sum += value * std::sin((i + 0.5) * step) * step;
    }
    return sum * 2 * std::numbers::pi / image.width;
  };
  const double natural = irradiance("0.5358");
  EXPECT_NEAR(irradiance("5") / natural, 1, 1e-4);
  EXPECT_NEAR(irradiance("0.01") / natural, 1, 1e-4);
  // 19950 W / (m^2 sr) over a disk of 0.5358 degrees.
  EXPECT_NEAR(natural, 19950 * 6.868e-5, 0.02 * natural);
}

TEST(Sky, StandsUprightInBothGenerations) {
  const Directory directory;
  const auto old = load_text(
      directory,
      scene_around("<emitter type=\"sky\"><vector name=\"sunDirection\" x=\"0\" y=\"1\" z=\"0\"/>"
                   "</emitter>",
                   "0.6.0"));
  ASSERT_TRUE(old) << old.error().to_string();
  const auto& upright = std::get<scene::EnvironmentEmitter>(old.value().emitters.at(0).model);
  EXPECT_EQ(upright.to_world, (scene::Matrix{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}));
  const auto turned = load_light<scene::EnvironmentEmitter>(
      "sky", "<vector name=\"sun_direction\" x=\"0\" y=\"0\" z=\"1\"/>");
  // The image's +y becomes the world's +z.
  EXPECT_EQ(turned.to_world[4 * 2 + 1], 1);
  EXPECT_EQ(error_of("<emitter type=\"sky\">\n<vector name=\"sun_direction\" x=\"0\" y=\"0\" "
                     "z=\"-1\"/></emitter>")
                .substr(0, 39),
            "scene.xml:2: the sun is below the horiz");
  EXPECT_EQ(error_of("<emitter type=\"sky\">\n<vector name=\"sun_direction\" x=\"0\" y=\"0\" "
                     "z=\"0\"/></emitter>"),
            "scene.xml:3: sun_direction must not be (0, 0, 0)");
}

}  // namespace
}  // namespace metrofarm::scene_file::test
