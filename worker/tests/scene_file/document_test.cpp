// Elements, parameters, includes, references, versions: everything above the single plugins.
#include <gtest/gtest.h>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

constexpr auto kSphereOfRadius = [](const std::string& radius) {
  return "<shape type=\"sphere\"><float name=\"radius\" value=\"" + radius + "\"/></shape>";
};

double radius_of(const scene::SceneDescription& scene, size_t shape = 0) {
  return std::get<scene::Sphere>(scene.shapes.at(shape).geometry).radius;
}

TEST(Defaults, ReplaceTextAnywhere) {
  const auto scene = load_valid(R"(<default name="kind" value="sphere"/>
<default name="r" value="2"/><default name="rr" value="$r.5"/>
<shape type="$kind"><float name="radius" value="$rr"/></shape>)");
  EXPECT_EQ(radius_of(scene), 2.5);
}

TEST(Defaults, FirstDefinitionWinsAndOverridesWinOverAll) {
  const std::string content =
      R"(<default name="r" value="2"/><default name="r" value="3"/>)" + kSphereOfRadius("$r");
  EXPECT_EQ(radius_of(load_valid(content)), 2);
  EXPECT_EQ(radius_of(load_valid(content, {.defaults = {{"r", "7"}}})), 7);
}

TEST(Defaults, LongestDefinedNameIsTaken) {
  EXPECT_EQ(radius_of(load_valid("<default name=\"r\" value=\"2\"/>" + kSphereOfRadius("$r0"))),
            20);
}

TEST(Defaults, UndefinedParameterIsAnError) {
  EXPECT_EQ(error_of(R"(<default name="radius" value="2"/>
)" + kSphereOfRadius("$raduis")),
            "scene.xml:3: undefined parameter \"$raduis\": define it with <default name=\"raduis\" "
            "value=\"...\"/> before its use; did you mean \"radius\"? (supported: radius)");
}

TEST(Defaults, UnknownOverrideIsAnError) {
  EXPECT_EQ(error_of(R"(<default name="spp" value="2"/>)", {.defaults = {{"ssp", "4"}}}),
            "scene.xml: the scene has no parameter \"ssp\" that a value could be set for; did you "
            "mean \"spp\"? (supported: spp)");
}

TEST(Defaults, ExponentialGrowthIsStopped) {
  std::string content = "<default name=\"a0\" value=\"aaaaaaaaaaaaaaaa\"/>";
  for (int i = 1; i < 40; ++i) {
    const std::string previous = "$a" + std::to_string(i - 1);
    content +=
        "\n<default name=\"a" + std::to_string(i) + "\" value=\"" + previous + previous + "\"/>";
  }
  EXPECT_EQ(error_of(content),
            "scene.xml:21: the value is longer than 4 MiB after its $parameters are replaced");
}

TEST(Include, SplicesASceneAndSharesParametersAndIds) {
  const Directory directory;
  directory.write("parts/shapes.xml", "<scene version=\"3.0.0\"><default name=\"r\" value=\"9\"/>" +
                                          kSphereOfRadius("$r") + "</scene>");
  directory.write("parts/bsdf.xml", R"(<bsdf version="3.0.0" type="conductor" id="metal"/>)");
  const auto scene = load_text(directory, scene_around(R"(<default name="r" value="4"/>
<include filename="parts/bsdf.xml"/><include filename="parts/shapes.xml"/>
<emitter type="constant"/><shape type="sphere"><ref id="metal"/></shape>)"));
  ASSERT_TRUE(scene) << scene.error().to_string();
  EXPECT_EQ(radius_of(scene.value()), 4);
  EXPECT_TRUE(std::holds_alternative<scene::Conductor>(
      scene.value().bsdfs.at(scene.value().shapes.at(1).bsdf).model));
}

TEST(Include, ErrorsNameTheIncludedFile) {
  const Directory directory;
  directory.write("part.xml", "<scene version=\"3.0.0\">\n\n<shape type=\"spere\"/></scene>");
  EXPECT_EQ(error_of(directory, "<include filename=\"part.xml\"/>"),
            "part.xml:3: shape \"spere\" is not supported; did you mean \"sphere\"? (supported: "
            "rectangle, cube, sphere, disk, cylinder, obj, ply, serialized, deformable)");
}

TEST(Include, MissingFileAndCyclesAreErrors) {
  EXPECT_EQ(error_of("\n<include filename=\"none.xml\"/>").substr(0, 43),
            "scene.xml:3: file \"none.xml\" not found; loo");
  EXPECT_EQ(error_of("<include filename=\"scene.xml\"/>"),
            "scene.xml:2: includes are nested too deeply or too many; does \"scene.xml\" include "
            "itself?");
}

TEST(References, WorkForwardsByAliasAndInNestedElements) {
  const auto scene = load_valid(R"(
<shape type="sphere"><ref id="later"/></shape>
<shape type="sphere"><ref name="material" id="other"/></shape>
<shape type="sphere"><bsdf type="diffuse" id="inner"/></shape>
<shape type="sphere"><ref id="inner"/></shape>
<bsdf type="conductor" id="later"/><alias id="later" as="other"/>)");
  ASSERT_EQ(scene.shapes.size(), 4U);
  EXPECT_EQ(scene.shapes[0].bsdf, scene.shapes[1].bsdf);
  EXPECT_EQ(scene.shapes[2].bsdf, scene.shapes[3].bsdf);
  EXPECT_EQ(scene.bsdfs.at(scene.shapes[0].bsdf).id, "later");
}

TEST(References, UnknownAndDuplicateIdsAreErrors) {
  EXPECT_EQ(error_of(R"(<bsdf type="diffuse" id="WallBSDF"/>
<shape type="sphere"><ref id="WalBSDF"/></shape>)"),
            "scene.xml:3: reference to unknown id \"WalBSDF\"; did you mean \"WallBSDF\"? "
            "(supported: WallBSDF)");
  EXPECT_EQ(error_of(R"(<bsdf type="diffuse" id="a"/>
<shape type="sphere" id="a"/>)"),
            "scene.xml:3: the id \"a\" is already taken by the bsdf at scene.xml:2: ids must be "
            "unique");
  EXPECT_EQ(error_of(R"(<alias id="a" as="b"/>)"),
            "scene.xml:2: <alias> names the unknown id \"a\"");
}

TEST(References, CyclesAreErrors) {
  EXPECT_EQ(error_of(R"(<bsdf type="twosided" id="a"><ref id="a"/></bsdf>)"),
            "scene.xml:2: bsdf \"twosided\" contains itself");
}

TEST(Elements, UnknownOnesAreErrorsWithTheNearestName) {
  EXPECT_EQ(error_of("<bsfd type=\"diffuse\"/>").substr(0, 58),
            "scene.xml:2: unknown element <bsfd>; did you mean \"bsdf\"? ");
  EXPECT_EQ(error_of("<shape kind=\"sphere\"/>"),
            "scene.xml:2: unknown attribute \"kind\" of <shape>; supported: type, id, name, "
            "version");
  EXPECT_EQ(error_of(R"(<shape type="sphere">
  <float name="radios" value="1"/></shape>)"),
            "scene.xml:3: unknown parameter \"radios\" of shape \"sphere\"; did you mean "
            "\"radius\"? (supported: flip_normals, to_world, center, radius)");
  EXPECT_EQ(error_of("<float name=\"gain\" value=\"1\"/>"),
            "scene.xml:2: unknown parameter \"gain\" of <scene>");
  EXPECT_EQ(error_of("<shape type=\"sphere\"><film type=\"hdrfilm\"/></shape>"),
            "scene.xml:2: film \"hdrfilm\" has no place in shape \"sphere\"");
  EXPECT_EQ(error_of("<shape type=\"sphere\"><float value=\"1\"/></shape>"),
            "scene.xml:2: <float> needs a name here");
  EXPECT_EQ(error_of(R"(<shape type="sphere"><float name="radius" value="1"/>
<float name="radius" value="2"/></shape>)"),
            "scene.xml:3: parameter \"radius\" of shape \"sphere\" is given twice");
}

TEST(Elements, ValuesOfTheWrongKindAreErrors) {
  EXPECT_EQ(error_of(kSphereOfRadius("2x")),
            "scene.xml:2: \"2x\" is not a number (attribute \"value\" of <float>)");
  EXPECT_EQ(error_of(kSphereOfRadius("nan")),
            "scene.xml:2: \"nan\" is not a number (attribute \"value\" of <float>)");
  EXPECT_EQ(error_of("<shape type=\"sphere\"><string name=\"radius\" value=\"2\"/></shape>"),
            "scene.xml:2: parameter \"radius\" of shape \"sphere\" must be a <float>, not a "
            "<string>");
  EXPECT_EQ(error_of("<shape type=\"sphere\"><boolean name=\"flip_normals\" value=\"1\"/></shape>"),
            "scene.xml:2: \"1\" must be \"true\" or \"false\" (parameter \"flip_normals\")");
  EXPECT_EQ(
      error_of(
          "<integrator type=\"path\"><integer name=\"max_depth\" value=\"3.5\"/></integrator>"),
      "scene.xml:2: \"3.5\" is not an integer (parameter \"max_depth\")");
}

TEST(Lenient, TurnsUnknownThingsIntoWarnings) {
  const auto scene = load_valid(R"(<shape type="torus"/><frobnicate/>
<shape type="sphere"><bsdf type="velvet"/><float name="glow" value="1"/></shape>
<shape type="sphere"><ref id="nowhere"/><medium name="interior" type="homogeneous"/></shape>
<emitter type="constant"/><emitter type="laser"/>)",
                                {.lenient = true});
  EXPECT_EQ(scene.shapes.size(), 2U);
  EXPECT_EQ(scene.emitters.size(), 1U);
  EXPECT_EQ(scene.warnings.size(), 7U);
  EXPECT_TRUE(
      std::holds_alternative<scene::Diffuse>(scene.bsdfs.at(scene.shapes.at(0).bsdf).model));
}

TEST(Versions, AreChecked) {
  const Directory directory;
  const auto error = [&](std::string_view xml) {
    const auto scene = load_text(directory, xml);
    return scene ? "" : scene.error().message;
  };
  EXPECT_EQ(error("<scene></scene>"), "the root element needs version=\"3.0.0\"");
  EXPECT_EQ(error("<scene version=\"new\"></scene>"),
            "invalid version \"new\": expected something like 3.0.0");
  EXPECT_EQ(error(scene_around("", "4.1.0")),
            "version 4.1.0 is newer than what is supported (0.4 to 3.x)");
  EXPECT_EQ(error(scene_around("", "2.1.0")), "");
  EXPECT_EQ(error("<bsdf version=\"3.0.0\" type=\"diffuse\"/>"),
            "the root element must be <scene version=\"3.0.0\">");
}

TEST(Versions, OldFilesUseCamelCase) {
  const Directory directory;
  const std::string content = R"(<integrator type="path"><integer name="maxDepth" value="4"/>
</integrator><bsdf type="dielectric" id="g"><float name="intIOR" value="1.5"/>
<float name="extIOR" value="1"/></bsdf><sensor type="perspective">
<transform name="toWorld"><lookAt origin="0,0,5" target="0,0,0" up="0,1,0"/></transform></sensor>)";
  const auto scene = load_text(directory, scene_around(content, "0.6.0"));
  ASSERT_TRUE(scene) << scene.error().to_string();
  EXPECT_EQ(scene.value().integrator.max_depth, 4);
  EXPECT_EQ(std::get<scene::Dielectric>(scene.value().bsdfs.at(0).model).eta, 1.5F);
  EXPECT_EQ(scene.value().sensor.to_world[11], 5);
  EXPECT_FALSE(load_text(directory, scene_around(content, "3.0.0")));
}

TEST(Scenes, NeedShapesAnEmitterAndASensor) {
  const Directory directory;
  const auto error = [&](const std::string& content) {
    const auto scene = load_text(directory, "<scene version=\"3.0.0\">" + content + "</scene>");
    return scene ? "" : scene.error().message;
  };
  const std::string sensor = "<sensor type=\"perspective\"/>";
  EXPECT_EQ(error(""), "the scene has no <sensor>: it needs one of type perspective");
  EXPECT_EQ(error(sensor), "the scene has no shapes: it needs at least one <shape>");
  EXPECT_EQ(error(sensor + "<shape type=\"sphere\"/><emitter type=\"area\"/>"),
            "the scene has no emitter: add an area light to a shape, a point light or a constant "
            "environment, or the image is black");
}

TEST(Scenes, MalformedXmlIsAnErrorWithItsLine) {
  const Directory directory;
  const auto scene = load_text(directory, "<scene version=\"3.0.0\">\n<shape>\n</scene>\n");
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().where.line, 3);
  EXPECT_FALSE(load_text(directory, ""));
}

TEST(Scenes, DeepNestingIsAnError) {
  std::string content;
  for (int i = 0; i < 100000; ++i) content += "<bsdf type=\"twosided\">";
  for (int i = 0; i < 100000; ++i) content += "</bsdf>";
  EXPECT_EQ(error_of(content), "scene.xml:2: elements are nested too deeply");
}

TEST(Scenes, UnknownExtensionsAreErrors) {
  const Directory directory;
  const auto scene = load_scene(directory.write("scene.blend", ""), {});
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().message,
            "no importer for files ending in \".blend\"; supported: .xml (Mitsuba XML), "
            ".pbrt (pbrt-v4)");
}

TEST(Scenes, ReportProgress) {
  std::vector<double> fractions;
  std::vector<std::string> names;
  LoadOptions options;
  options.progress = [&](double fraction, std::string_view what) {
    fractions.push_back(fraction);
    names.emplace_back(what);
  };
  load_valid("<shape type=\"sphere\" id=\"ball\"/><shape type=\"cube\"/>", options);
  EXPECT_EQ(fractions, (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(names,
            (std::vector<std::string>{"shape \"sphere\" ball", "shape \"cube\"", "scene loaded"}));
}

}  // namespace
}  // namespace metrofarm::scene_file::test
