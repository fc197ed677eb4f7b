// Materials, textures and spectra of pbrt scenes.
#include <gtest/gtest.h>

#include <cmath>

#include "pbrt_support.h"
#include "scene_file/pbrt/environment.h"

namespace metrofarm::scene_file::test {
namespace {

scene::SceneDescription with_material(std::string_view material) {
  return valid_pbrt(std::string(material) + " Shape \"disk\"");
}

// The material of the first shape, without the twosided around it.
template <class Model>
Model model_of(const scene::SceneDescription& scene) {
  if (scene.shapes.empty()) return {};
  const scene::Bsdf* bsdf = &scene.bsdfs.at(static_cast<size_t>(scene.shapes[0].bsdf));
  if (const auto* sides = std::get_if<scene::TwoSided>(&bsdf->model)) {
    EXPECT_EQ(sides->front, sides->back);
    bsdf = &scene.bsdfs.at(static_cast<size_t>(sides->front));
  }
  const Model* model = std::get_if<Model>(&bsdf->model);
  EXPECT_NE(model, nullptr);
  return model ? *model : Model{};
}

TEST(PbrtMaterials, Diffuse) {
  EXPECT_EQ(model_of<scene::Diffuse>(with_material("")).reflectance.value,
            (scene::Rgb{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(
      model_of<scene::Diffuse>(with_material("Material \"diffuse\" \"rgb reflectance\" [.1 .2 .3]"))
          .reflectance.value,
      (scene::Rgb{0.1F, 0.2F, 0.3F}));
}

TEST(PbrtMaterials, RoughnessIsRemappedByItsSquareRoot) {
  const auto remapped = model_of<scene::RoughConductor>(
      with_material("Material \"conductor\" \"float roughness\" 0.04"));
  EXPECT_FLOAT_EQ(remapped.alpha_u.value, 0.2F);
  EXPECT_EQ(remapped.distribution, scene::Microfacet::kGgx);
  const auto plain = model_of<scene::RoughConductor>(
      with_material("Material \"conductor\" \"float uroughness\" 0.04 \"float vroughness\" 0.1 "
                    "\"bool remaproughness\" false"));
  EXPECT_FLOAT_EQ(plain.alpha_u.value, 0.04F);
  EXPECT_FLOAT_EQ(plain.alpha_v.value, 0.1F);
}

TEST(PbrtMaterials, RoughGlassOfEqualIndicesIsSmooth) {
  EXPECT_EQ(model_of<scene::Dielectric>(
                with_material("Material \"dielectric\" \"float roughness\" 0.3 \"float eta\" 1"))
                .eta,
            1);
}

TEST(PbrtMaterials, ANormalMapIsReadOnce) {
  const Directory directory;
  directory.write("n.pfm", "PF\n1 1\n-1\n" + std::string(12, '\0'));
  const std::string shape = "Material \"diffuse\" \"string normalmap\" \"n.pfm\" Shape \"disk\" ";
  const auto scene = load_pbrt(directory, pbrt_around(shape + shape));
  ASSERT_TRUE(scene) << scene.error().to_string();
  EXPECT_EQ(scene.value().images.size(), 1U);
  EXPECT_EQ(scene.value().shapes.size(), 2U);
}

TEST(PbrtMaterials, Conductors) {
  const auto copper = model_of<scene::Conductor>(with_material("Material \"conductor\""));
  EXPECT_NEAR(copper.eta[0], 0.201, 0.01);
  const auto silver = model_of<scene::Conductor>(
      with_material("Material \"conductor\" \"spectrum eta\" \"metal-Ag-eta\" \"spectrum k\" "
                    "\"metal-Ag-k\""));
  EXPECT_NEAR(silver.k[0], 4.83, 0.05);
  // Normal incidence: ((eta - 1)^2 + k^2) / ((eta + 1)^2 + k^2).
  const auto painted = model_of<scene::Conductor>(
      with_material("Material \"conductor\" \"rgb reflectance\" [.25 .5 .75]"));
  for (size_t i = 0; i < 3; ++i) {
    const double k2 = painted.k[i] * painted.k[i];
    EXPECT_NEAR(k2 / (4 + k2), 0.25 * (static_cast<double>(i) + 1), 1e-6);
    EXPECT_EQ(painted.eta[i], 1);
  }
}

TEST(PbrtMaterials, Dielectrics) {
  EXPECT_FLOAT_EQ(model_of<scene::Dielectric>(with_material("Material \"dielectric\"")).eta, 1.5F);
  EXPECT_NEAR(model_of<scene::Dielectric>(
                  with_material("Material \"dielectric\" \"spectrum eta\" \"glass-BK7\""))
                  .eta,
              1.5168, 1e-4);
  EXPECT_FLOAT_EQ(
      model_of<scene::RoughDielectric>(
          with_material("Material \"dielectric\" \"float roughness\" .01 \"float eta\" 1.3"))
          .alpha_v.value,
      0.1F);
  model_of<scene::ThinDielectric>(with_material("Material \"thindielectric\""));
  model_of<scene::Null>(with_material("Material \"interface\""));
}

TEST(PbrtMaterials, CoatedOnesTakeTheNearest) {
  const auto smooth = with_material("Material \"coateddiffuse\" \"rgb reflectance\" [.4 .2 .2]");
  EXPECT_TRUE(model_of<scene::Plastic>(smooth).nonlinear);
  EXPECT_EQ(smooth.warnings.size(), 1U);
  EXPECT_NEAR(model_of<scene::RoughPlastic>(
                  with_material("Material \"coateddiffuse\" \"float roughness\" 0.25"))
                  .alpha,
              0.5, 1e-6);
  model_of<scene::Conductor>(with_material("Material \"coatedconductor\""));
}

TEST(PbrtMaterials, DiffuseTransmissionBlendsBothSides) {
  const auto scene = with_material(
      "Material \"diffusetransmission\" \"rgb reflectance\" [.6 .3 0] "
      "\"rgb transmittance\" [.2 .2 .2]");
  const auto blend = model_of<scene::Blend>(scene);
  const float w = blend.weight.value;
  const auto& through =
      std::get<scene::DiffuseTransmitter>(scene.bsdfs.at(static_cast<size_t>(blend.second)).model);
  EXPECT_NEAR(w * through.transmittance.value[0], 0.2, 1e-6);
  const auto& sides =
      std::get<scene::TwoSided>(scene.bsdfs.at(static_cast<size_t>(blend.first)).model);
  const auto& back =
      std::get<scene::Diffuse>(scene.bsdfs.at(static_cast<size_t>(sides.front)).model);
  EXPECT_NEAR((1 - w) * back.reflectance.value[1], 0.3, 1e-6);
  EXPECT_LE(back.reflectance.value[0], 1);
}

TEST(PbrtMaterials, MixesByNameAndAmount) {
  const auto blend = model_of<scene::Blend>(
      with_material("MakeNamedMaterial \"a\" \"string type\" \"diffuse\" "
                    "MakeNamedMaterial \"b\" \"string type\" \"conductor\" "
                    "Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" .3"));
  EXPECT_FLOAT_EQ(blend.weight.value, 0.3F);
  EXPECT_NE(pbrt_error(pbrt_around("MakeNamedMaterial \"a\" \"string type\" \"mix\" \"string "
                                   "materials\" [\"a\" \"a\"] NamedMaterial \"a\" "
                                   "Shape \"sphere\""))
                .find("mixes itself"),
            std::string::npos);
}

TEST(PbrtMaterials, AlphaMasksAShape) {
  const auto mask = model_of<scene::Mask>(valid_pbrt("Shape \"disk\" \"float alpha\" 0.25"));
  EXPECT_FLOAT_EQ(mask.opacity.value, 0.25F);
}

TEST(PbrtTextures, ConstantsFoldIntoColours) {
  const auto diffuse = model_of<scene::Diffuse>(with_material(
      "Texture \"c\" \"spectrum\" \"constant\" \"rgb value\" [.5 .5 1] "
      "Texture \"s\" \"spectrum\" \"scale\" \"texture tex\" \"c\" \"float scale\" .5 "
      "Texture \"m\" \"spectrum\" \"mix\" \"texture tex1\" \"s\" \"rgb tex2\" [1 1 1] "
      "Material \"diffuse\" \"texture reflectance\" \"m\""));
  EXPECT_EQ(diffuse.reflectance.texture, scene::kNone);
  EXPECT_FLOAT_EQ(diffuse.reflectance.value[0], 0.625F);
  EXPECT_FLOAT_EQ(diffuse.reflectance.value[2], 0.75F);
}

TEST(PbrtTextures, CheckerboardsCountWholeUnits) {
  const auto scene = valid_pbrt(
      "Texture \"c\" \"spectrum\" \"checkerboard\" \"float uscale\" 4 \"float vdelta\" 1 "
      "Material \"diffuse\" \"texture reflectance\" \"c\" "
      "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]");
  ASSERT_EQ(scene.textures.size(), 1U);
  const auto& board = std::get<scene::CheckerboardTexture>(scene.textures[0].model);
  // floor(2 u') must be floor(4 u), floor(2 v') floor(v + 1).
  EXPECT_EQ(board.to_uv, (scene::UvMatrix{2, 0, 0, 0, 0.5F, 0.5F}));
  EXPECT_EQ(board.colour0.value, (scene::Rgb{1, 1, 1}));
}

// pbrt measures v on a sphere from the south pole.
TEST(PbrtTextures, CoordinatesOfSpheresAreTurned) {
  const auto scene = valid_pbrt(
      "Texture \"c\" \"spectrum\" \"checkerboard\" "
      "Material \"diffuse\" \"texture reflectance\" \"c\" "
      "Shape \"sphere\"");
  ASSERT_EQ(scene.textures.size(), 1U);
  const auto& board = std::get<scene::CheckerboardTexture>(scene.textures[0].model);
  EXPECT_EQ(board.to_uv, (scene::UvMatrix{0.5F, 0, 0, 0, -0.5F, 0.5F}));
}

TEST(PbrtTextures, MistakesAreNamed) {
  EXPECT_NE(pbrt_error(pbrt_around("Material \"diffuse\" \"texture reflectance\" \"x\" "
                                   "Shape \"sphere\""))
                .find("no spectrum texture is named \"x\""),
            std::string::npos);
  EXPECT_NE(
      pbrt_error(pbrt_around("Texture \"t\" \"spectrum\" \"scale\" \"texture tex\" \"t\" "
                             "Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\""))
          .find("refers to itself"),
      std::string::npos);
  EXPECT_NE(
      pbrt_error(pbrt_around("Texture \"t\" \"spectrum\" \"marble\" "
                             "Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"sphere\""))
          .find("not supported"),
      std::string::npos);
}

TEST(PbrtSpectra, ConstantReflectancesAreGrey) {
  const auto diffuse = model_of<scene::Diffuse>(
      with_material("Material \"diffuse\" \"spectrum reflectance\" [360 .4 830 .4]"));
  for (float channel : diffuse.reflectance.value) EXPECT_NEAR(channel, 0.4, 2e-3);
}

// The square maps onto the sphere in equal areas: the poles and the equator's axes are known.
TEST(PbrtEnvironment, DirectionsInTheSquare) {
  struct Case {
    Point direction;
    double u, v;
  };
  for (const Case& c : {Case{{0, 0, 1}, 0.5, 0.5}, Case{{1, 0, 0}, 1, 0.5}, Case{{0, 1, 0}, 0.5, 1},
                        Case{{-1, 0, 0}, 0, 0.5}, Case{{0, -1, 0}, 0.5, 0}}) {
    const auto [u, v] = pbrt::equal_area_square(c.direction);
    EXPECT_NEAR(u, c.u, 1e-12);
    EXPECT_NEAR(v, c.v, 1e-12);
  }
  const auto [u, v] = pbrt::equal_area_square({1e-9, 1e-9, -1});
  EXPECT_NEAR(u, 1, 1e-4);
  EXPECT_NEAR(v, 1, 1e-4);
}

// A map that is bright around one direction shows it there after conversion, with the same flux.
TEST(PbrtEnvironment, ConversionKeepsDirectionsAndFlux) {
  scene::Image map;
  map.width = map.height = 64;
  std::vector<float> pixels(64 * 64 * 3, 0.F);
  const Point bright = normalized({0.3, -0.5, 0.7});
  const auto [u, v] = pbrt::equal_area_square(bright);
  const auto x0 = static_cast<int>(u * 64), y0 = static_cast<int>(v * 64);
  for (int y = y0 - 2; y <= y0 + 2; ++y) {
    for (int x = x0 - 2; x <= x0 + 2; ++x) pixels[static_cast<size_t>(y * 64 + x) * 3] = 1;
  }
  map.pixels = pixels;
  const auto image = pbrt::to_latitude_longitude(map);
  ASSERT_TRUE(image);
  const auto& converted = std::get<std::vector<float>>(image.value().pixels);
  const int width = image.value().width, height = image.value().height;
  double flux = 0;
  Point mean{};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double theta = M_PI * (y + 0.5) / height, phi = 2 * M_PI * (x + 0.5) / width;
      const double weight = converted[static_cast<size_t>(y * width + x) * 3] * std::sin(theta) *
                            2 * M_PI * M_PI / width / height;
      flux += weight;
      mean[0] += weight * std::sin(theta) * std::sin(phi);
      mean[1] += weight * std::cos(theta);
      mean[2] -= weight * std::sin(theta) * std::cos(phi);
    }
  }
  EXPECT_NEAR(flux, 25 * 4 * M_PI / (64 * 64), 0.03 * flux);
  EXPECT_GT(dot(normalized(mean), bright), 0.999);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
