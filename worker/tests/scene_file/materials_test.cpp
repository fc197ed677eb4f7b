// Colours, bsdfs and emitters. Numbers that aren't in the file were read from Mitsuba 3.9.1
// (scalar_rgb).
#include <gtest/gtest.h>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

using scene::Rgb;

std::string bsdf(const std::string& type, const std::string& content) {
  return "<bsdf type=\"" + type + "\">\n" + content + "</bsdf>";
}

template <class Model>
Model load_bsdf(const std::string& type, const std::string& content) {
  const auto scene = load_valid(bsdf(type, content));
  EXPECT_FALSE(scene.bsdfs.empty());
  return std::get<Model>(scene.bsdfs.at(0).model);
}

Rgb reflectance(const std::string& content) {
  return load_bsdf<scene::Diffuse>("diffuse", content).reflectance;
}

void expect_near(const Rgb& actual, const Rgb& expected) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(actual[i], expected[i], 1e-5F * expected[i]) << i;
}

TEST(Colours, AllNotations) {
  const Rgb expected = {0.1F, 0.2F, 0.3F};
  EXPECT_EQ(reflectance("<rgb name=\"reflectance\" value=\"0.1, 0.2, 0.3\"/>"), expected);
  EXPECT_EQ(reflectance("<rgb name=\"reflectance\" value=\" 0.1 0.2  0.3 \"/>"), expected);
  const Rgb grey = {0.25F, 0.25F, 0.25F};
  EXPECT_EQ(reflectance("<rgb name=\"reflectance\" value=\"0.25\"/>"), grey);
  EXPECT_EQ(reflectance("<float name=\"reflectance\" value=\"0.25\"/>"), grey);
  EXPECT_EQ(reflectance("<spectrum name=\"reflectance\" value=\"0.25\"/>"), grey);
  EXPECT_EQ(reflectance(""), (Rgb{0.5F, 0.5F, 0.5F}));
  expect_near(reflectance("<rgb name=\"reflectance\" value=\"#ff8000\"/>"), {1, 0.2158605F, 0});
}

TEST(Colours, ConstantSpectraOfEmittersAreWhiteOfEqualEnergy) {
  const auto intensity = [](const std::string& tag) {
    const auto scene = load_valid("<emitter type=\"point\"><" + tag +
                                  " name=\"intensity\" value=\"3\"/></emitter>");
    return std::get<scene::PointEmitter>(scene.emitters.at(0).model).intensity;
  };
  expect_near(intensity("spectrum"), {3.61438F, 2.84487F, 2.72675F});
  EXPECT_EQ(intensity("rgb"), (Rgb{3, 3, 3}));
  EXPECT_EQ(intensity("float"), (Rgb{3, 3, 3}));
}

TEST(Colours, Errors) {
  const auto error = [](const std::string& element) { return error_of(bsdf("diffuse", element)); };
  const std::string range =
      "scene.xml:3: colour \"reflectance\" of bsdf \"diffuse\" must be between 0 and 1";
  EXPECT_EQ(error("<rgb name=\"reflectance\" value=\"1.5, 0, 0\"/>"), range);
  EXPECT_EQ(error("<rgb name=\"reflectance\" value=\"0, -1, 0\"/>"), range);
  EXPECT_EQ(error("<rgb name=\"reflectance\" value=\"0.1, 0.2\"/>"),
            "scene.xml:3: \"0.1, 0.2\" is not a colour: expected \"r, g, b\", one number or "
            "\"#rrggbb\"");
  EXPECT_NE(error("<rgb name=\"reflectance\" value=\"#12345g\"/>"), "");
  EXPECT_EQ(error("<spectrum name=\"reflectance\" value=\"400:0.1, 700:0.2\"/>"),
            "scene.xml:3: spectra of wavelength:value pairs, from files or of other kinds are not "
            "supported yet; give an <rgb> or a constant <spectrum value=\"...\"/>");
  EXPECT_EQ(error("<texture name=\"reflectance\" type=\"bitmap\"/>"),
            "scene.xml:3: parameter \"reflectance\" of bsdf \"diffuse\" must be an <rgb>, "
            "<spectrum> or <float>; texture \"bitmap\" is not supported here");
  EXPECT_EQ(error("<rgb name=\"reflektance\" value=\"1\"/>"),
            "scene.xml:3: unknown parameter \"reflektance\" of bsdf \"diffuse\"; did you mean "
            "\"reflectance\"? (supported: reflectance)");
  EXPECT_EQ(error_of("<emitter type=\"constant\"><rgb name=\"radiance\" value=\"-1\"/></emitter>"),
            "scene.xml:2: colour \"radiance\" of emitter \"constant\" must be finite and not "
            "negative");
}

TEST(Conductor, ByNumbersNamesAndDefault) {
  const auto mirror = load_bsdf<scene::Conductor>("conductor", "");
  EXPECT_EQ(mirror.eta, (Rgb{0, 0, 0}));
  EXPECT_EQ(mirror.k, (Rgb{1, 1, 1}));
  const auto gold =
      load_bsdf<scene::Conductor>("conductor", "<string name=\"material\" value=\"Au\"/>");
  expect_near(gold.eta, {0.143036F, 0.375307F, 1.44205F});
  expect_near(gold.k, {3.983F, 2.38556F, 1.60336F});
  const auto numbers = load_bsdf<scene::Conductor>(
      "conductor",
      "<rgb name=\"eta\" value=\"0.2, 0.9, 1.1\"/><spectrum name=\"k\" value=\"2\"/>"
      "<rgb name=\"specular_reflectance\" value=\"0.3\"/>");
  EXPECT_EQ(numbers.eta, (Rgb{0.2F, 0.9F, 1.1F}));
  EXPECT_EQ(numbers.k, (Rgb{2, 2, 2}));
  EXPECT_EQ(numbers.specular_reflectance, (Rgb{0.3F, 0.3F, 0.3F}));
}

TEST(Conductor, Errors) {
  EXPECT_EQ(error_of(bsdf("conductor", "<string name=\"material\" value=\"Agg\"/>")).substr(0, 62),
            "scene.xml:3: unknown conductor \"Agg\"; did you mean \"Ag\"? (supp");
  EXPECT_EQ(error_of(bsdf("conductor",
                          "<string name=\"material\" value=\"Ag\"/>"
                          "<rgb name=\"eta\" value=\"1\"/>")),
            "scene.xml:3: give either material or eta and k, not both");
}

TEST(RoughConductor, ReadsRoughness) {
  const auto model = load_bsdf<scene::RoughConductor>(
      "roughconductor",
      "<string name=\"distribution\" value=\"GGX\"/><float name=\"alpha_u\" value=\"0.2\"/>"
      "<float name=\"alpha_v\" value=\"0\"/><boolean name=\"sample_visible\" value=\"true\"/>");
  EXPECT_EQ(model.distribution, scene::Microfacet::kGgx);
  EXPECT_EQ(model.alpha_u, 0.2F);
  EXPECT_EQ(model.alpha_v, 1e-4F);
  const auto plain = load_bsdf<scene::RoughConductor>("roughconductor", "");
  EXPECT_EQ(plain.distribution, scene::Microfacet::kBeckmann);
  EXPECT_EQ(plain.alpha_u, 0.1F);
  EXPECT_EQ(plain.alpha_v, 0.1F);
}

TEST(RoughConductor, Errors) {
  EXPECT_EQ(error_of(bsdf("roughconductor", "<float name=\"alpha_u\" value=\"0.2\"/>")),
            "scene.xml:3: give either alpha or both alpha_u and alpha_v");
  EXPECT_EQ(error_of(bsdf("roughconductor", "<float name=\"alpha\" value=\"-0.2\"/>")),
            "scene.xml:3: parameter \"alpha\" of bsdf \"roughconductor\" must be between 0 and "
            "1000000, not -0.2");
  EXPECT_EQ(error_of(bsdf("roughconductor", "<string name=\"distribution\" value=\"bekman\"/>")),
            "scene.xml:3: unknown microfacet distribution \"bekman\"; did you mean \"beckmann\"? "
            "(supported: beckmann, ggx)");
}

TEST(Dielectric, ByNumbersNamesAndDefault) {
  const auto eta = [](const std::string& content) {
    return load_bsdf<scene::Dielectric>("dielectric", content).eta;
  };
  EXPECT_FLOAT_EQ(eta(""), 1.504183292F);
  EXPECT_FLOAT_EQ(eta("<string name=\"int_ior\" value=\"Diamond\"/>"
                      "<string name=\"ext_ior\" value=\"vacuum\"/>"),
                  2.419F);
  EXPECT_FLOAT_EQ(eta("<float name=\"int_ior\" value=\"1.5\"/><integer name=\"ext_ior\" "
                      "value=\"1\"/>"),
                  1.5F);
  EXPECT_EQ(
      error_of(bsdf("dielectric", "<string name=\"int_ior\" value=\"watre\"/>")).substr(0, 110),
      "scene.xml:3: unknown material \"watre\" for \"int_ior\"; a number is written <float "
      "name=\"int_ior\" .../>; did you ");
  EXPECT_EQ(error_of(bsdf("dielectric", "<float name=\"ext_ior\" value=\"0\"/>")),
            "scene.xml:3: parameter \"ext_ior\" must be greater than 0");
}

TEST(TwoSided, HasOneOrTwoReflectiveSides) {
  const auto scene =
      load_valid(bsdf("twosided", "<bsdf type=\"diffuse\"/><bsdf type=\"conductor\"/>") +
                 bsdf("twosided", "<bsdf type=\"diffuse\"/>"));
  ASSERT_EQ(scene.bsdfs.size(), 6U);  // and the sphere's default
  const auto& both = std::get<scene::TwoSided>(scene.bsdfs[2].model);
  EXPECT_TRUE(std::holds_alternative<scene::Diffuse>(scene.bsdfs[both.front].model));
  EXPECT_TRUE(std::holds_alternative<scene::Conductor>(scene.bsdfs[both.back].model));
  const auto& same = std::get<scene::TwoSided>(scene.bsdfs[4].model);
  EXPECT_EQ(same.front, same.back);
  EXPECT_EQ(
      error_of(bsdf("twosided", "")),
      "scene.xml:2: a twosided bsdf needs one or two nested bsdfs, for the front and the back");
  EXPECT_EQ(error_of(bsdf("twosided", "<bsdf type=\"dielectric\"/>")),
            "scene.xml:2: a bsdf inside twosided must only reflect: a dielectric already has two "
            "sides, use it without twosided");
}

TEST(Emitters, AreReadWhereTheyBelong) {
  const auto scene = load_valid(R"(<emitter type="area" id="lamp">
<rgb name="radiance" value="1, 2, 3"/></emitter>
<emitter type="point"><transform name="to_world"><translate y="4"/></transform></emitter>
<emitter type="constant"><float name="sampling_weight" value="2"/></emitter>
<shape type="cube"><ref id="lamp"/></shape>)");
  ASSERT_EQ(scene.emitters.size(), 3U);
  EXPECT_EQ(std::get<scene::PointEmitter>(scene.emitters[0].model).position,
            (scene::Point{0, 4, 0}));
  EXPECT_EQ(std::get<scene::ConstantEmitter>(scene.emitters[1].model).radiance, (Rgb{1, 1, 1}));
  EXPECT_EQ(std::get<scene::AreaEmitter>(scene.emitters[2].model).radiance, (Rgb{1, 2, 3}));
  EXPECT_EQ(scene.shapes.at(0).area_emitter, 2);
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(Emitters, Errors) {
  EXPECT_EQ(error_of(R"(<emitter type="area" id="lamp"/>
<shape type="cube"><ref id="lamp"/></shape><shape type="cube"><ref id="lamp"/></shape>)"),
            "scene.xml:2: an emitter can be attached to one shape only");
  EXPECT_EQ(error_of("<shape type=\"cube\"><emitter type=\"point\"/></shape>"),
            "scene.xml:2: only an area emitter can be part of a shape; emitter \"point\" belongs "
            "directly into the <scene>");
  EXPECT_EQ(error_of("<emitter type=\"constant\"/>\n<emitter type=\"constant\"/>"),
            "scene.xml:3: a scene can have only one environment emitter");
  EXPECT_EQ(error_of(R"(<emitter type="point"><point name="position" value="1"/>
<transform name="to_world"/></emitter>)"),
            "scene.xml:2: give either position or to_world, not both");
  EXPECT_EQ(error_of("<emitter type=\"pont\"/>"),
            "scene.xml:2: emitter \"pont\" is not supported; did you mean \"point\"? (supported: "
            "area, point, constant)");
  EXPECT_EQ(load_valid("<emitter type=\"constant\"/><emitter type=\"area\"/>").warnings.size(), 1U);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
