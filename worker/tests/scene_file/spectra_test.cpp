// Colours and spectra in all their notations. Numbers that aren't in the files were read from
// Mitsuba 3.9.1 (scalar_rgb), see spectra_reference.py.
#include "material_support.h"

namespace metrofarm::scene_file::test {
namespace {

using scene::Rgb;

Rgb reflectance(const std::string& content) {
  return load_bsdf<scene::Diffuse>("diffuse", content).reflectance.value;
}

Rgb intensity(const std::string& content) {
  const auto scene = load_valid("<emitter type=\"point\">" + content + "</emitter>");
  const auto* point = std::get_if<scene::PointEmitter>(&scene.emitters.at(0).model);
  return point ? point->intensity : Rgb{-1, -1, -1};
}

std::string error(const std::string& element) {
  return error_of(bsdf("diffuse", element));
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

TEST(Colours, OldNotations) {
  const auto old = [](const std::string& content) {
    return load_legacy_bsdf<scene::Diffuse>("diffuse", content).reflectance.value;
  };
  EXPECT_EQ(old("<spectrum name=\"reflectance\" value=\"0.1, 0.2, 0.3\"/>"),
            (Rgb{0.1F, 0.2F, 0.3F}));
  expect_near(old("<srgb name=\"reflectance\" value=\"0.5, 1, 0\"/>"), {0.2140411F, 1, 0});
  expect_near(old("<srgb name=\"diffuseReflectance\" value=\"#ff8000\"/>"), {1, 0.2158605F, 0});
}

TEST(Colours, ConstantSpectraOfEmittersAreWhiteOfEqualEnergy) {
  expect_near(intensity("<spectrum name=\"intensity\" value=\"3\"/>"),
              {3.61438F, 2.84487F, 2.72675F});
  EXPECT_EQ(intensity("<rgb name=\"intensity\" value=\"3\"/>"), (Rgb{3, 3, 3}));
  EXPECT_EQ(intensity("<float name=\"intensity\" value=\"3\"/>"), (Rgb{3, 3, 3}));
}

TEST(Colours, Errors) {
  const std::string range =
      "scene.xml:3: colour \"reflectance\" of bsdf \"diffuse\" must be between 0 and 1";
  EXPECT_EQ(error("<rgb name=\"reflectance\" value=\"1.5, 0, 0\"/>"), range);
  EXPECT_EQ(error("<rgb name=\"reflectance\" value=\"0, -1, 0\"/>"), range);
  EXPECT_EQ(error("<rgb name=\"reflectance\" value=\"0.1, 0.2\"/>"),
            "scene.xml:3: \"0.1, 0.2\" is not a colour: expected \"r, g, b\", one number or "
            "\"#rrggbb\"");
  EXPECT_NE(error("<rgb name=\"reflectance\" value=\"#12345g\"/>"), "");
  EXPECT_EQ(error("<spectrum name=\"reflectance\" value=\"0.1, 0.2, 0.3\"/>"),
            "scene.xml:3: \"0.1, 0.2, 0.3\" is not a spectrum: expected one number or "
            "\"wavelength:value, ...\"; a colour is written <rgb value=\"r, g, b\"/>");
  EXPECT_EQ(error("<string name=\"reflectance\" value=\"red\"/>"),
            "scene.xml:3: parameter \"reflectance\" of bsdf \"diffuse\" must be an <rgb>, "
            "<spectrum> or <float>; <string> is not supported here");
  EXPECT_EQ(error("<rgb name=\"reflektance\" value=\"1\"/>"),
            "scene.xml:3: unknown parameter \"reflektance\" of bsdf \"diffuse\"; did you mean "
            "\"reflectance\"? (supported: reflectance)");
  EXPECT_EQ(error_of("<emitter type=\"constant\"><rgb name=\"radiance\" value=\"-1\"/></emitter>"),
            "scene.xml:2: colour \"radiance\" of emitter \"constant\" must be finite and not "
            "negative");
}

// A list of wavelength:value pairs and what Mitsuba makes of it as a reflectance, as an index of
// refraction and as an emission.
struct Reference {
  const char* pairs;
  Rgb reflectance, index, emission;
};

constexpr Reference kReferences[] = {
    {"400:0.1, 500:0.2, 600:0.9, 700:0.3",
     {0.935471F, 0.498117F, 0.100384F},
     {0.935471F, 0.498117F, 0.100384F},
     {1.06947F, 0.481563F, 0.0834412F}},
    {"300:1, 900:1",
     {0.998985F, 0.998874F, 0.998802F},
     {0.998985F, 0.998874F, 0.998802F},
     {1.20488F, 0.948228F, 0.909267F}},
    {"400:0, 500:0, 501:1, 540:1, 541:0, 700:0",
     {0, 0.482882F, 0},
     {0, 0.482882F, 0},
     {0, 0.448859F, 0}},
    {"400:1.5, 500:3, 600:2",
     {0.0252785F, 1, 1},
     {0.0252785F, 2.72519F, 2.30558F},
     {0.212385F, 2.60204F, 2.07743F}},
    {"380:0.04 460:0.07 461.5:0.5 600:0.4 780:0.45",
     {0.357454F, 0.474256F, 0.190643F},
     {0.357454F, 0.474256F, 0.190643F},
     {0.443986F, 0.45023F, 0.161624F}},
    {"400:0, 500:8, 600:15.6, 700:18.4",
     {1, 1, 1},
     {17.7147F, 11.3544F, 3.30451F},
     {20.7108F, 10.8546F, 2.77115F}},
};

TEST(Spectra, AgreeWithMitsuba) {
  // Mitsuba sums in single precision and prints six digits.
  constexpr float kTolerance = 3e-5F;
  for (const Reference& reference : kReferences) {
    SCOPED_TRACE(reference.pairs);
    const std::string pairs = reference.pairs;
    expect_near(reflectance(parameter("spectrum", "reflectance", pairs)), reference.reflectance,
                kTolerance);
    expect_near(load_bsdf<scene::Conductor>("conductor", parameter("spectrum", "eta", pairs)).eta,
                reference.index, kTolerance);
    expect_near(intensity(parameter("spectrum", "intensity", pairs)), reference.emission,
                kTolerance);
  }
}

TEST(Spectra, SayWhenTheColourIsOutsideTheGamut) {
  const auto scene = load_valid(
      bsdf("diffuse", "<spectrum name=\"reflectance\" value=\"500:0, 501:1, 540:1, 541:0\"/>"));
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_EQ(scene.warnings[0].where.line, 3);
  EXPECT_NE(scene.warnings[0].message.find("outside the gamut"), std::string::npos);
}

TEST(Spectra, ComeFromFiles) {
  const Directory directory;
  directory.write("red.spd", "# measured\n400 0.1\n500 0.2 # here\r\n\n600 0.9\n700 0.3");
  const std::string content =
      bsdf("diffuse", "<spectrum name=\"reflectance\" filename=\"red.spd\"/>");
  const auto scene = load_text(directory, scene_around(content));
  ASSERT_TRUE(scene) << scene.error().to_string();
  expect_near(first_model<scene::Diffuse>(scene.value()).reflectance.value,
              kReferences[0].reflectance, 3e-5F);

  directory.write("red.spd", "400 0.1\n\n500 red\n");
  EXPECT_EQ(error_of(directory, content),
            "red.spd:3: \"500 red\" must be a wavelength in nm and a value");
  directory.write("red.spd", "400 0.1\n");
  EXPECT_NE(error_of(directory, content).find("at least two wavelengths"), std::string::npos);
  EXPECT_EQ(error("<spectrum name=\"reflectance\" filename=\"blue.spd\"/>").substr(0, 43),
            "scene.xml:3: file \"blue.spd\" not found; loo");
}

TEST(Spectra, OfOtherKinds) {
  // Planck's law at 3000 K through the same integration.
  const Rgb warm = {733.1102F, 349.5688F, 112.7106F};
  const std::string kelvin = "<float name=\"temperature\" value=\"3000\"/>";
  const std::string begin = "<spectrum name=\"intensity\" type=\"";
  expect_near(intensity(begin + "blackbody\">" + kelvin + "</spectrum>"), warm, 1e-4F);
  expect_near(intensity(begin + "blackbody\">" + kelvin +
                        "<float name=\"scale\" value=\"0.01\"/></spectrum>"),
              {7.331102F, 3.495688F, 1.127106F}, 1e-4F);
  const auto old = load_legacy(
      "<emitter type=\"point\"><blackbody name=\"intensity\" temperature=\"3000K\"/></emitter>");
  expect_near(std::get<scene::PointEmitter>(old.emitters.at(0).model).intensity, warm, 1e-4F);

  EXPECT_EQ(intensity(begin + "d65\"><float name=\"scale\" value=\"2\"/></spectrum>"),
            (Rgb{2, 2, 2}));
  EXPECT_EQ(intensity(begin + "uniform\"><float name=\"value\" value=\"3\"/></spectrum>"),
            (Rgb{3, 3, 3}));
  EXPECT_EQ(intensity(begin + "srgb\"><rgb name=\"color\" value=\"1, 2, 3\"/></spectrum>"),
            (Rgb{1, 2, 3}));
  EXPECT_EQ(
      intensity(begin + "rawconstant\"><vector name=\"value\" value=\"1, 2, 3\"/></spectrum>"),
      (Rgb{1, 2, 3}));
  const std::string values = "<string name=\"values\" value=\"0.1, 0.2, 0.9, 0.3\"/>";
  expect_near(intensity(begin +
                        "irregular\"><string name=\"wavelengths\" value=\"400 500 600 "
                        "700\"/>" +
                        values + "</spectrum>"),
              kReferences[0].emission, 3e-5F);
  expect_near(intensity(begin +
                        "regular\"><float name=\"wavelength_min\" value=\"400\"/>"
                        "<float name=\"wavelength_max\" value=\"700\"/>" +
                        values + "</spectrum>"),
              kReferences[0].emission, 3e-5F);
}

TEST(Spectra, Errors) {
  const auto spectrum = [](const std::string& value) {
    return error(parameter("spectrum", "reflectance", value));
  };
  EXPECT_EQ(
      spectrum("400:0.1, 500"),
      "scene.xml:3: \"500\" is not a pair of wavelength and value as in \"400:0.5, 700:0.6\"");
  EXPECT_EQ(spectrum("400:0.1"), "scene.xml:3: a spectrum needs at least two wavelengths");
  EXPECT_EQ(spectrum("400:0.1, 500:0.2, 500:0.3"),
            "scene.xml:3: the wavelengths of a spectrum must grow, but 500 follows 500");
  const auto plugin = [](const std::string& type, const std::string& content) {
    return error("<spectrum name=\"reflectance\" type=\"" + type + "\">" + content + "</spectrum>");
  };
  EXPECT_EQ(plugin("blackbody", ""),
            "scene.xml:3: spectrum \"blackbody\" needs a temperature in kelvin");
  EXPECT_EQ(plugin("blackbody", "<float name=\"temperature\" value=\"-3\"/>"),
            "scene.xml:3: the temperature of a black body must be between 0 and 1000000 kelvin");
  EXPECT_EQ(plugin("irregular",
                   "<string name=\"wavelengths\" value=\"400, 500\"/>"
                   "<string name=\"values\" value=\"1, 2, 3\"/>"),
            "scene.xml:3: a spectrum needs as many values as wavelengths, not 3 for 2");
  EXPECT_EQ(plugin("uniform", "<float name=\"valu\" value=\"1\"/>"),
            "scene.xml:3: unknown parameter \"valu\" of spectrum \"uniform\"; did you mean "
            "\"value\"? (supported: value)");
}

}  // namespace
}  // namespace metrofarm::scene_file::test
