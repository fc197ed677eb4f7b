// Materials that nest no others, in both generations of the format. Numbers that aren't in the file
// were read from Mitsuba 3.9.1 (scalar_rgb).
#include "material_support.h"

namespace metrofarm::scene_file::test {
namespace {

using scene::Rgb;

const std::string kCheckerboard = "<texture type=\"checkerboard\" name=\"";

std::string checkerboard(const std::string& name) {
  return kCheckerboard + name + "\"/>";
}

TEST(Diffuse, ByNumberTextureAndOldName) {
  EXPECT_EQ(load_bsdf<scene::Diffuse>("diffuse", "").reflectance.value, (Rgb{0.5F, 0.5F, 0.5F}));
  const auto textured = load_bsdf<scene::Diffuse>("diffuse", checkerboard("reflectance"));
  EXPECT_EQ(textured.reflectance.texture, 0);
  EXPECT_EQ(textured.reflectance.value, (Rgb{1, 1, 1}));
  const auto old = load_legacy_bsdf<scene::Diffuse>(
      "diffuse", parameter("rgb", "diffuseReflectance", "0.1, 0.2, 0.3"));
  EXPECT_EQ(old.reflectance.value, (Rgb{0.1F, 0.2F, 0.3F}));
}

TEST(RoughDiffuse, IsDiffuseWithAWarning) {
  const auto scene = load_legacy(bsdf("roughdiffuse", parameter("rgb", "reflectance", "0.3")));
  EXPECT_EQ(first_model<scene::Diffuse>(scene).reflectance.value, (Rgb{0.3F, 0.3F, 0.3F}));
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_EQ(scene.warnings[0].where.line, 2);
  EXPECT_TRUE(load_legacy(bsdf("roughdiffuse", parameter("float", "alpha", "0"))).warnings.empty());
}

TEST(DiffuseTransmitter, ReadsTransmittance) {
  EXPECT_EQ(load_legacy_bsdf<scene::DiffuseTransmitter>("difftrans", "").transmittance.value,
            (Rgb{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(
      load_bsdf<scene::DiffuseTransmitter>("difftrans", parameter("rgb", "transmittance", "0.2"))
          .transmittance.value,
      (Rgb{0.2F, 0.2F, 0.2F}));
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
  EXPECT_EQ(numbers.specular_reflectance.value, (Rgb{0.3F, 0.3F, 0.3F}));
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
  EXPECT_EQ(model.alpha_u.value, 0.2F);
  EXPECT_EQ(model.alpha_v.value, 1e-4F);
  const auto plain = load_bsdf<scene::RoughConductor>("roughconductor", "");
  EXPECT_EQ(plain.distribution, scene::Microfacet::kBeckmann);
  EXPECT_EQ(plain.alpha_u.value, 0.1F);
  EXPECT_EQ(plain.alpha_v.value, 0.1F);
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

TEST(Conductor, OldDefaultsAreCopperInAir) {
  constexpr float kAir = 1.000277F;
  const auto copper = load_legacy_bsdf<scene::Conductor>("conductor", "");
  expect_near(copper.eta, {0.2010055F / kAir, 0.9237495F / kAir, 1.102215F / kAir});
  const auto numbers = load_legacy_bsdf<scene::RoughConductor>(
      "roughconductor", parameter("spectrum", "eta", "3") + parameter("spectrum", "k", "6") +
                            parameter("float", "extEta", "1.5") +
                            parameter("float", "alphaU", "0.2") +
                            parameter("float", "alphaV", "0.3"));
  EXPECT_EQ(numbers.eta, (Rgb{2, 2, 2}));
  EXPECT_EQ(numbers.k, (Rgb{4, 4, 4}));
  EXPECT_EQ(numbers.alpha_u.value, 0.2F);
  EXPECT_EQ(numbers.alpha_v.value, 0.3F);
  const auto mirror =
      load_legacy_bsdf<scene::Conductor>("conductor", parameter("string", "material", "none"));
  EXPECT_EQ(mirror.eta, (Rgb{0, 0, 0}));
  EXPECT_EQ(error_of(bsdf("conductor", parameter("float", "ext_eta", "1"))).substr(0, 33),
            "scene.xml:3: unknown parameter \"e");
}

TEST(Conductor, TakesNoTexturedIndices) {
  EXPECT_EQ(error_of(bsdf("conductor", checkerboard("eta"))),
            "scene.xml:3: parameter \"eta\" of bsdf \"conductor\" must be an <rgb>, <spectrum> or "
            "<float>; texture \"checkerboard\" is not supported here");
}

TEST(RoughConductor, TexturedRoughness) {
  const auto model = load_bsdf<scene::RoughConductor>(
      "roughconductor", checkerboard("alpha") + checkerboard("specular_reflectance"));
  EXPECT_EQ(model.alpha_u.texture, 0);
  EXPECT_EQ(model.alpha_v.texture, 0);
  EXPECT_EQ(model.alpha_u.value, 1);
  EXPECT_EQ(model.specular_reflectance.texture, 1);
}

TEST(RoughConductor, OldDistributions) {
  const std::string phong = bsdf("roughconductor", parameter("string", "distribution", "phong"));
  EXPECT_EQ(legacy_error_of(phong),
            "scene.xml:3: the microfacet distribution \"phong\" of Mitsuba 0.6 is not supported; "
            "the nearest is \"beckmann\"");
  EXPECT_NE(error_of(phong).find("unknown microfacet distribution"), std::string::npos);
  const LoadOptions lenient{.lenient = true};
  EXPECT_EQ(load_valid(phong, lenient).warnings.size(), 1U);
}

TEST(ThinDielectric, DefaultsAndParameters) {
  EXPECT_FLOAT_EQ(load_bsdf<scene::ThinDielectric>("thindielectric", "").eta, 1.504183292F);
  const auto model = load_legacy_bsdf<scene::ThinDielectric>(
      "thindielectric", parameter("float", "intIOR", "1.5") + parameter("float", "extIOR", "1") +
                            parameter("spectrum", "specularTransmittance", "0.9") +
                            parameter("spectrum", "specularReflectance", "0.8"));
  EXPECT_FLOAT_EQ(model.eta, 1.5F);
  EXPECT_EQ(model.specular_transmittance.value[1], 0.9F);
  EXPECT_EQ(model.specular_reflectance.value[1], 0.8F);
}

TEST(RoughDielectric, DefaultsAndParameters) {
  const auto plain = load_bsdf<scene::RoughDielectric>("roughdielectric", "");
  EXPECT_EQ(plain.distribution, scene::Microfacet::kBeckmann);
  EXPECT_EQ(plain.alpha_u.value, 0.1F);
  EXPECT_FLOAT_EQ(plain.eta, 1.504183292F);
  const auto model = load_bsdf<scene::RoughDielectric>(
      "roughdielectric",
      parameter("string", "distribution", "ggx") + parameter("float", "alpha", "0.4") +
          parameter("string", "int_ior", "water") + checkerboard("specular_transmittance"));
  EXPECT_EQ(model.distribution, scene::Microfacet::kGgx);
  EXPECT_EQ(model.alpha_v.value, 0.4F);
  EXPECT_FLOAT_EQ(model.eta, 1.333F / 1.000277F);
  EXPECT_EQ(model.specular_transmittance.texture, 0);
  EXPECT_EQ(error_of(bsdf("roughdielectric", parameter("string", "int_ior", "air"))),
            "scene.xml:2: bsdf \"roughdielectric\" needs different indices of refraction inside "
            "and outside");
}

TEST(Plastic, DefaultsAndParameters) {
  const auto plain = load_bsdf<scene::Plastic>("plastic", "");
  EXPECT_FLOAT_EQ(plain.eta, 1.489587390F);
  EXPECT_EQ(plain.diffuse_reflectance.value, (Rgb{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(plain.specular_reflectance.value, (Rgb{1, 1, 1}));
  EXPECT_FALSE(plain.nonlinear);
  const auto model = load_legacy_bsdf<scene::Plastic>(
      "plastic", parameter("boolean", "nonlinear", "true") +
                     parameter("rgb", "diffuseReflectance", "0.1") +
                     parameter("float", "intIOR", "1.9"));
  EXPECT_TRUE(model.nonlinear);
  EXPECT_EQ(model.diffuse_reflectance.value[0], 0.1F);
  EXPECT_FLOAT_EQ(model.eta, 1.9F / 1.000277F);
}

TEST(RoughPlastic, DefaultsAndParameters) {
  const auto plain = load_bsdf<scene::RoughPlastic>("roughplastic", "");
  EXPECT_EQ(plain.alpha, 0.1F);
  EXPECT_EQ(plain.distribution, scene::Microfacet::kBeckmann);
  const auto model = load_bsdf<scene::RoughPlastic>(
      "roughplastic",
      parameter("float", "alpha", "0") + parameter("string", "distribution", "ggx") +
          checkerboard("diffuse_reflectance") + parameter("boolean", "nonlinear", "true"));
  EXPECT_EQ(model.alpha, 1e-4F);
  EXPECT_EQ(model.distribution, scene::Microfacet::kGgx);
  EXPECT_EQ(model.diffuse_reflectance.texture, 0);
  EXPECT_TRUE(model.nonlinear);
  EXPECT_EQ(error_of(bsdf("roughplastic", checkerboard("alpha"))),
            "scene.xml:3: parameter \"alpha\" of bsdf \"roughplastic\" must be a <float>, not a "
            "<texture>");
}

// By the brightest place of both together; a texture counts with what is in it.
TEST(Phong, ReflectsAtMostWhatFallsIn) {
  const auto model = [](const std::string& diffuse) {
    return load_legacy_bsdf<scene::Phong>(
        "phong", diffuse + "<rgb name=\"specularReflectance\" value=\"0.5, 0.4, 0.5\"/>");
  };
  const auto bright = model("<rgb name=\"diffuseReflectance\" value=\"0.1, 0.8, 0.3\"/>");
  EXPECT_FLOAT_EQ(bright.diffuse_reflectance.value[1], 0.8F * 0.99F / 1.2F);
  EXPECT_FLOAT_EQ(bright.specular_reflectance.value[0], 0.5F * 0.99F / 1.2F);
  const std::string board =
      "<texture name=\"diffuseReflectance\" type=\"checkerboard\">"
      "<rgb name=\"color0\" value=\"0.1, 0.2, 0.3\"/>"
      "<rgb name=\"color1\" value=\"GREEN\"/></texture>";
  const auto with_green = [&](const std::string& value) {
    std::string text = board;
    return model(text.replace(text.find("GREEN"), 5, value));
  };
  EXPECT_EQ(with_green("0.3, 0.6, 0.3").specular_reflectance.value[0], 0.5F);
  EXPECT_EQ(with_green("0.3, 0.6, 0.3").diffuse_reflectance.value[0], 1.F);
  EXPECT_FLOAT_EQ(with_green("0.3, 0.9, 0.3").diffuse_reflectance.value[0], 0.99F / 1.3F);
}

TEST(Phong, DefaultsAndParameters) {
  const auto plain = load_legacy_bsdf<scene::Phong>("phong", "");
  EXPECT_EQ(plain.exponent.value, 30);
  EXPECT_EQ(plain.diffuse_reflectance.value, (Rgb{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(plain.specular_reflectance.value, (Rgb{0.2F, 0.2F, 0.2F}));
  const auto model = load_legacy_bsdf<scene::Phong>(
      "phong", parameter("float", "exponent", "5") + checkerboard("diffuseReflectance") +
                   parameter("spectrum", "specularReflectance", "0.1, 0.2, 0.3"));
  EXPECT_EQ(model.exponent.value, 5);
  EXPECT_EQ(model.diffuse_reflectance.texture, 0);
  EXPECT_EQ(model.specular_reflectance.value, (Rgb{0.1F, 0.2F, 0.3F}));
}

TEST(Principled, DefaultsAndParameters) {
  const auto plain = load_bsdf<scene::Principled>("principled", "");
  EXPECT_EQ(plain.base_color.value, (Rgb{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(plain.roughness.value, 0.5F);
  EXPECT_EQ(plain.metallic.value, 0);
  EXPECT_FLOAT_EQ(plain.eta, 1.5F);
  const auto model = load_bsdf<scene::Principled>(
      "principled", checkerboard("base_color") + checkerboard("roughness") +
                        parameter("float", "metallic", "0.7") +
                        parameter("float", "specular", "0.3") +
                        parameter("float", "clearcoat_gloss", "0.9") +
                        parameter("float", "main_specular_sampling_rate", "2"));
  EXPECT_EQ(model.base_color.texture, 0);
  EXPECT_EQ(model.roughness.texture, 1);
  EXPECT_EQ(model.metallic.value, 0.7F);
  EXPECT_FLOAT_EQ(model.eta, 1.3666379F);
  EXPECT_EQ(model.clearcoat_gloss.value, 0.9F);
  EXPECT_EQ(model.main_specular_sampling_rate, 2);
  EXPECT_EQ(load_bsdf<scene::Principled>("principled", parameter("float", "eta", "1.3")).eta, 1.3F);
}

TEST(Principled, SomeLobeMustBeSampled) {
  const auto zero = [](const std::string& name) { return parameter("float", name, "0"); };
  const std::string rates =
      zero("main_specular_sampling_rate") + zero("diffuse_reflectance_sampling_rate");
  EXPECT_EQ(error_of(bsdf("principled", rates)), "");
  EXPECT_EQ(error_of(bsdf("principled", rates + zero("clearcoat_sampling_rate"))),
            "scene.xml:2: one of the sampling rates of bsdf \"principled\" must be greater than 0");
  EXPECT_EQ(
      error_of(bsdf("principledthin", zero("specular_reflectance_sampling_rate") +
                                          zero("specular_transmittance_sampling_rate") +
                                          zero("diffuse_reflectance_sampling_rate") +
                                          zero("diffuse_transmittance_sampling_rate"))),
      "scene.xml:2: one of the sampling rates of bsdf \"principledthin\" must be greater than "
      "0");
}

TEST(Principled, ColoursInPlaceOfNumbersHaveTheirRangeToo) {
  EXPECT_EQ(
      error_of(bsdf("principled", parameter("rgb", "metallic", "0.5, 1, 2"))).substr(0, 83),
      "scene.xml:3: parameter \"metallic\" of bsdf \"principled\" must be between 0 and 1, not");
}

TEST(Principled, Errors) {
  EXPECT_EQ(error_of(bsdf("principled", parameter("float", "specular", "0.5") +
                                            parameter("float", "eta", "1.5"))),
            "scene.xml:3: give either specular or eta, not both");
  EXPECT_EQ(error_of(bsdf("principled", parameter("float", "metallic", "1.5"))),
            "scene.xml:3: parameter \"metallic\" of bsdf \"principled\" must be between 0 and 1, "
            "not 1.5");
  EXPECT_EQ(error_of(bsdf("principled", parameter("float", "metalic", "1"))).substr(0, 87),
            "scene.xml:3: unknown parameter \"metalic\" of bsdf \"principled\"; did you mean "
            "\"metallic\"?");
}

TEST(PrincipledThin, DefaultsAndParameters) {
  const auto plain = load_bsdf<scene::PrincipledThin>("principledthin", "");
  EXPECT_EQ(plain.eta.value, 1.5F);
  EXPECT_EQ(plain.diff_trans.value, 0);
  const auto model = load_bsdf<scene::PrincipledThin>(
      "principledthin", parameter("float", "diff_trans", "1.6") + checkerboard("spec_trans") +
                            parameter("float", "diffuse_transmittance_sampling_rate", "3"));
  EXPECT_EQ(model.diff_trans.value, 1.6F);
  EXPECT_EQ(model.spec_trans.texture, 0);
  EXPECT_EQ(model.diffuse_transmittance_sampling_rate, 3);
}

TEST(Null, HasNoParameters) {
  load_bsdf<scene::Null>("null", "");
  EXPECT_NE(error_of(bsdf("null", parameter("float", "opacity", "1"))), "");
}

TEST(UnsupportedBsdfs, NameTheNearest) {
  const std::string coating = bsdf("coating", "<bsdf type=\"diffuse\"/>");
  EXPECT_EQ(legacy_error_of(coating),
            "scene.xml:2: bsdf \"coating\" is not supported; the nearest that is: \"plastic\"");
  const LoadOptions lenient{.lenient = true};
  const auto scene = load_valid(coating, lenient);
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_EQ(scene.warnings[0].message,
            "bsdf \"coating\" is not supported; the nearest that is: \"plastic\"; a grey diffuse "
            "bsdf takes its place");
  EXPECT_EQ(error_of(bsdf("difuse", "")).substr(0, 67),
            "scene.xml:2: bsdf \"difuse\" is not supported; did you mean \"diffuse\"");
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
  EXPECT_EQ(std::get<scene::AreaEmitter>(scene.emitters[2].model).radiance.value, (Rgb{1, 2, 3}));
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
            "area, point, constant, envmap, spot, directional, projector, sunsky, sky, sun)");
  EXPECT_EQ(load_valid("<emitter type=\"constant\"/><emitter type=\"area\"/>").warnings.size(), 1U);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
