// Lights, cameras, films and integrators of pbrt scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "pbrt_support.h"
#include "scene_file/affine.h"

namespace metrofarm::scene_file::test {
namespace {

constexpr double kPi = std::numbers::pi;

template <class Model>
Model emitter_of(const scene::SceneDescription& scene, size_t i = 0) {
  const Model* model =
      i < scene.emitters.size() ? std::get_if<Model>(&scene.emitters[i].model) : nullptr;
  EXPECT_NE(model, nullptr);
  return model ? *model : Model{};
}

TEST(PbrtLights, RgbIsRadianceTimesScaleAndImagingRatio) {
  const auto light = emitter_of<scene::AreaEmitter>(
      valid_pbrt("AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float scale\" 2 "
                 "Shape \"disk\"",
                 "Film \"rgb\" \"float iso\" 50 Camera \"perspective\" \"float shutterclose\" 3"));
  EXPECT_EQ(light.radiance.value, (scene::Rgb{3, 6, 9}));
}

TEST(PbrtLights, SpectraHaveALuminanceOfOne) {
  for (const char* colour : {"\"blackbody L\" 3000", "\"spectrum L\" [360 5 830 7]",
                             "\"spectrum L\" \"stdillum-A\"", ""}) {
    const auto rgb = emitter_of<scene::ConstantEmitter>(
                         valid_pbrt(std::string("LightSource \"infinite\" ") + colour))
                         .radiance;
    EXPECT_NEAR(0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2], 1, 2e-3) << colour;
  }
}

TEST(PbrtLights, PowerOverridesTheScale) {
  const auto point = emitter_of<scene::PointEmitter>(
      valid_pbrt("Translate 1 0 0 LightSource \"point\" \"float power\" 100 \"point3 from\" "
                 "[0 2 0] \"rgb I\" [1 1 1]"));
  EXPECT_NEAR(point.intensity[0], 100 / (4 * kPi), 1e-4);
  EXPECT_EQ(point.position, (Point{1, 2, 0}));
  const auto disk = emitter_of<scene::AreaEmitter>(
      valid_pbrt("AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"float power\" 10 Shape \"disk\" "
                 "\"float radius\" 2"));
  EXPECT_NEAR(disk.radiance.value[1], 10 / (kPi * 4 * kPi), 1e-6);
}

TEST(PbrtLights, PowerOfWhatMovesIsThatOfItsSizeInTheWorld) {
  const std::string move = "ActiveTransform EndTime Translate 1 0 0 ActiveTransform All ";
  const std::string light = "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"float power\" 10 ";
  for (const char* shape : {"Shape \"disk\"", "Shape \"sphere\"", "Shape \"cylinder\"",
                            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]"}) {
    const auto still = emitter_of<scene::AreaEmitter>(valid_pbrt("Scale 9 9 9 " + light + shape));
    const auto moving =
        emitter_of<scene::AreaEmitter>(valid_pbrt("Scale 9 9 9 " + move + light + shape));
    EXPECT_NEAR(moving.radiance.value[1] / still.radiance.value[1], 1, 1e-4) << shape;
  }
}

TEST(PbrtLights, DistantLightTravelsFromTo) {
  const auto light = emitter_of<scene::DirectionalEmitter>(
      valid_pbrt("LightSource \"distant\" \"point3 from\" [0 5 0] \"point3 to\" [0 0 0] "
                 "\"float illuminance\" 7 \"rgb L\" [1 1 1]"));
  EXPECT_NEAR(light.direction[1], -1, 1e-12);
  EXPECT_NEAR(light.irradiance[0], 7, 1e-6);
}

TEST(PbrtLights, SpotPointsFromTo) {
  const auto light = emitter_of<scene::SpotEmitter>(
      valid_pbrt("LightSource \"spot\" \"point3 from\" [1 1 1] \"point3 to\" [1 1 -4] "
                 "\"float coneangle\" 40 \"float conedeltaangle\" 10"));
  EXPECT_NEAR(column(light.to_world, 2)[2], -1, 1e-12);
  EXPECT_EQ(column(light.to_world, 3), (Point{1, 1, 1}));
  EXPECT_EQ(light.cutoff_degrees, 40);
  EXPECT_EQ(light.beam_width_degrees, 30);
}

TEST(PbrtLights, TwoSidedLightsAreTwoSurfaces) {
  const auto scene = valid_pbrt(
      "AreaLightSource \"diffuse\" \"bool twosided\" true Shape \"trianglemesh\" \"point3 P\" "
      "[0 0 0 1 0 0 0 1 0]");
  ASSERT_EQ(scene.shapes.size(), 2U);
  ASSERT_EQ(scene.emitters.size(), 2U);
  EXPECT_NE(scene.shapes[0].flip_normals, scene.shapes[1].flip_normals);
  const auto z = [&](size_t i) {
    return std::get<scene::TriangleMesh>(scene.shapes[i].geometry).positions[2];
  };
  // The flipped one lies behind the one that faces +z.
  EXPECT_LT(z(scene.shapes[0].flip_normals ? 0 : 1), z(scene.shapes[0].flip_normals ? 1 : 0));
}

TEST(PbrtLights, OthersAreRefused) {
  for (const char* light : {"goniometric", "projection"}) {
    const std::string error = pbrt_error(pbrt_around("LightSource \"" + std::string(light) + "\""));
    EXPECT_NE(error.find("not supported"), std::string::npos) << error;
  }
  EXPECT_NE(pbrt_error(pbrt_around("LightSource \"infinite\" \"blackbody L\" [6500 2]")), "");
  EXPECT_NE(pbrt_error(pbrt_around("LightSource \"infinite\" \"rgb L\" [-1 0 0]")), "");
}

// The direction in which the camera sees the point (x, y) of its film, each in [-1, 1], x to the
// right and y up.
Point direction_at(const scene::SceneDescription& scene, double x, double y) {
  const scene::Sensor& sensor = scene.sensor;
  const double tangent = std::tan(sensor.fov_x_degrees * kPi / 360);
  const double aspect = static_cast<double>(scene.film.width) / scene.film.height;
  const double right = tangent * (x + 2 * sensor.principal_point_offset_x);
  const double up = tangent / aspect * (y - 2 * sensor.principal_point_offset_y);
  const Matrix& m = sensor.to_world;
  const Point ahead = {m[2], m[6], m[10]};
  return normalized({ahead[0] - m[0] * right + m[1] * up, ahead[1] - m[4] * right + m[5] * up,
                     ahead[2] - m[8] * right + m[9] * up});
}

void expect_direction(const Point& actual, const Point& expected) {
  const Point unit = normalized(expected);
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(actual[i], unit[i], 1e-9) << "axis " << i;
}

TEST(PbrtCamera, LooksAlongZWithXToTheRight) {
  const auto scene = valid_pbrt("",
                                "Camera \"perspective\" Film \"rgb\" \"integer xresolution\" "
                                "200 \"integer yresolution\" 100");
  expect_direction(direction_at(scene, 0, 0), {0, 0, 1});
  // 90 degrees along the shorter axis.
  expect_direction(direction_at(scene, 0, 1), {0, 1, 1});
  expect_direction(direction_at(scene, 1, 0), {2, 0, 1});
}

TEST(PbrtCamera, TheShorterAxisOfATallFilmIsX) {
  const auto scene = valid_pbrt("",
                                "Camera \"perspective\" \"float fov\" 40 Film \"rgb\" "
                                "\"integer xresolution\" 100 \"integer yresolution\" 200");
  EXPECT_NEAR(scene.sensor.fov_x_degrees, 40, 1e-9);
}

TEST(PbrtCamera, LookAtAndMirror) {
  const auto plain = valid_pbrt("", "LookAt 1 2 3 1 2 13 0 1 0 Camera \"perspective\"");
  expect_direction(direction_at(plain, 0, 0), {0, 0, 1});
  expect_direction(direction_at(plain, 9.0 / 16, 0), {1, 0, 1});
  EXPECT_EQ(column(plain.sensor.to_world, 3), (Point{1, 2, 3}));
  const auto mirrored =
      valid_pbrt("", "Scale -1 1 1 LookAt 1 2 3 1 2 13 0 1 0 Camera \"perspective\"");
  expect_direction(direction_at(mirrored, 9.0 / 16, 0), {-1, 0, 1});
}

TEST(PbrtCamera, ScreenWindowsMoveTheImage) {
  const auto scene = valid_pbrt("",
                                "Camera \"perspective\" \"float screenwindow\" [0 1 -.5 .5] "
                                "Film \"rgb\" \"integer xresolution\" 100 \"integer "
                                "yresolution\" 100");
  expect_direction(direction_at(scene, -1, 0), {0, 0, 1});
  expect_direction(direction_at(scene, 1, 1), {1, 0.5, 1});
}

TEST(PbrtCamera, LensesAndScaledCameras) {
  const auto scene = valid_pbrt("",
                                "Scale .5 .5 .5 Camera \"perspective\" \"float lensradius\" .1 "
                                "\"float focaldistance\" 4");
  EXPECT_EQ(scene.sensor.projection, scene::Projection::kThinLens);
  EXPECT_NEAR(scene.sensor.aperture_radius, 0.2, 1e-12);
  EXPECT_NEAR(scene.sensor.focus_distance, 8, 1e-12);
}

TEST(PbrtCamera, Orthographic) {
  const auto scene = valid_pbrt("",
                                "Camera \"orthographic\" \"float screenwindow\" [-3 1 -2 2] "
                                "Film \"rgb\" \"integer xresolution\" 100 \"integer "
                                "yresolution\" 100");
  EXPECT_EQ(scene.sensor.projection, scene::Projection::kOrthographic);
  // The film's left edge is +1 in x of the sensor's space.
  EXPECT_NEAR(transform_point(scene.sensor.to_world, {1, 0, 0})[0], -3, 1e-12);
  EXPECT_NEAR(transform_point(scene.sensor.to_world, {-1, 1, 0})[1], 2, 1e-12);
}

TEST(PbrtFilm, CropWindowsAndFilters) {
  const auto scene = valid_pbrt("",
                                "Film \"rgb\" \"integer xresolution\" 100 \"integer "
                                "yresolution\" 50 \"float cropwindow\" [.5 1 0 .5] "
                                "PixelFilter \"mitchell\"");
  EXPECT_EQ(scene.film.crop.x, 50);
  EXPECT_EQ(scene.film.crop.width, 50);
  EXPECT_EQ(scene.film.crop.height, 25);
  EXPECT_EQ(scene.film.filter, scene::ReconstructionFilter::kMitchell);
  EXPECT_EQ(valid_pbrt("").film.filter_radius, 1.5);
  EXPECT_NE(pbrt_error("Film \"rgb\" \"integer pixelbounds\" [0 2000 0 10]\n" + pbrt_around("")),
            "");
}

TEST(PbrtIntegrator, BouncesAreOneLessThanEdges) {
  EXPECT_EQ(valid_pbrt("").integrator.max_depth, 6);
  const auto scene =
      valid_pbrt("",
                 "Integrator \"path\" \"integer maxdepth\" 0 Sampler \"halton\" \"integer "
                 "pixelsamples\" 9");
  EXPECT_EQ(scene.integrator.max_depth, 1);
  EXPECT_EQ(scene.integrator.sample_count, 9);
  EXPECT_EQ(valid_pbrt("", "Integrator \"nice\"").warnings.size(), 1U);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
