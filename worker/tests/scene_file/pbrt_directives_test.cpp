// Syntax, transforms, attributes, objects and files of pbrt scenes.
#include <gtest/gtest.h>

#include <cmath>

#include "pbrt_support.h"
#include "scene_file/affine.h"

namespace metrofarm::scene_file::test {
namespace {

scene::Point center_of(const scene::SceneDescription& scene, size_t i = 0) {
  const auto* sphere =
      i < scene.shapes.size() ? std::get_if<scene::Sphere>(&scene.shapes[i].geometry) : nullptr;
  EXPECT_NE(sphere, nullptr);
  return sphere ? sphere->center : scene::Point{};
}

void expect_near(const scene::Point& actual, const scene::Point& expected) {
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(actual[i], expected[i], 1e-9) << "axis " << i;
}

bool contains(const std::string& text, std::string_view part) {
  return text.find(part) != std::string::npos;
}

TEST(PbrtDirectives, TransformsApplyToWhatFollows) {
  expect_near(center_of(valid_pbrt("Translate 1 2 3 Scale 2 2 2 Translate 1 0 0 "
                                   "Shape \"sphere\"")),
              {3, 2, 3});
  expect_near(center_of(valid_pbrt("Rotate 90 0 0 1 Translate 1 0 0 Shape \"sphere\"")), {0, 1, 0});
  expect_near(center_of(valid_pbrt("Transform [1 0 0 0  0 1 0 0  0 0 1 0  4 5 6 1] "
                                   "ConcatTransform [2 0 0 0  0 2 0 0  0 0 2 0  1 1 1 1] "
                                   "Shape \"sphere\"")),
              {5, 6, 7});
}

TEST(PbrtDirectives, LookAtIsTheInverseOfThePlacement) {
  // What stands at the eye goes to the origin, what stands before it to +z.
  expect_near(center_of(valid_pbrt("LookAt 1 2 3  1 2 7  0 1 0 Translate 1 2 5 Shape \"sphere\"")),
              {0, 0, 2});
}

TEST(PbrtDirectives, AttributeBlocksRestoreTheState) {
  const auto scene = valid_pbrt(
      "AttributeBegin Translate 1 0 0 ReverseOrientation Shape \"sphere\" AttributeEnd "
      "Shape \"sphere\"");
  expect_near(center_of(scene, 0), {1, 0, 0});
  expect_near(center_of(scene, 1), {0, 0, 0});
  EXPECT_TRUE(scene.shapes[0].flip_normals);
  EXPECT_FALSE(scene.shapes[1].flip_normals);
}

TEST(PbrtDirectives, NamedCoordinateSystemsComeBack) {
  expect_near(center_of(valid_pbrt("Translate 1 2 3 CoordinateSystem \"here\" Identity "
                                   "CoordSysTransform \"here\" Shape \"sphere\"")),
              {1, 2, 3});
  // The camera's frame is known by name.
  expect_near(center_of(valid_pbrt("CoordSysTransform \"camera\" Translate 0 0 2 "
                                   "Shape \"sphere\"",
                                   "Translate 0 0 -5 Camera \"perspective\"")),
              {0, 0, 7});
}

TEST(PbrtDirectives, ThingsMoveFromTransformToTransform) {
  const auto scene = valid_pbrt(
      "LightSource \"infinite\" "
      "Shape \"sphere\" ActiveTransform EndTime Translate 10 0 0 ActiveTransform All "
      "Translate 0 1 0 Shape \"sphere\" ObjectBegin \"o\" ActiveTransform All Identity "
      "Shape \"disk\" ObjectEnd ObjectInstance \"o\" LightSource \"point\"",
      "TransformTimes 1 3 ActiveTransform EndTime Translate 0 0 -8 ActiveTransform All "
      "Camera \"perspective\" \"float shutteropen\" 1.5 \"float shutterclose\" 2");
  ASSERT_EQ(scene.shapes.size(), 3U);
  EXPECT_TRUE(scene.shapes[0].motion.empty());
  expect_near(std::get<scene::Sphere>(scene.shapes[1].geometry).center, {0, 0, 0});
  ASSERT_EQ(scene.shapes[1].motion.keys.size(), 2U);
  EXPECT_EQ(scene.shapes[1].motion.keys[0].time, 1);
  EXPECT_EQ(scene.shapes[1].motion.keys[1].time, 3);
  expect_near(column(scene.shapes[1].motion.keys[0].to_world, 3), {0, 1, 0});
  expect_near(column(scene.shapes[1].motion.keys[1].to_world, 3), {10, 1, 0});
  ASSERT_EQ(scene.instances.size(), 1U);
  EXPECT_EQ(scene.instances[0].motion.keys.size(), 2U);
  ASSERT_EQ(scene.emitters.size(), 2U);
  EXPECT_TRUE(scene.emitters[0].motion.empty());
  EXPECT_EQ(scene.emitters[1].motion.keys.size(), 2U);
  ASSERT_EQ(scene.sensor.motion.keys.size(), 2U);
  expect_near(column(scene.sensor.motion.keys[1].to_world, 3), {0, 0, 8});
  EXPECT_EQ(scene.sensor.shutter_open, 1.5);
  EXPECT_EQ(scene.sensor.shutter_close, 2);
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(PbrtDirectives, ShapesOfObjectsStandWhereTheShutterOpens) {
  const auto scene = valid_pbrt(
      "LightSource \"infinite\" ObjectBegin \"o\" ActiveTransform EndTime Translate 8 0 0 "
      "Shape \"sphere\" ObjectEnd ActiveTransform All Identity ObjectInstance \"o\"",
      "Camera \"perspective\" \"float shutteropen\" 0.25");
  expect_near(center_of(scene), {2, 0, 0});
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_TRUE(contains(scene.warnings[0].message, "moves with its instances only"));
}

TEST(PbrtDirectives, ObjectsBecomeGroupsWithInstances) {
  const auto scene = valid_pbrt(
      "ObjectBegin \"o\" Translate 1 0 0 Shape \"sphere\" Shape \"disk\" ObjectEnd "
      "Translate 0 5 0 ObjectInstance \"o\" ObjectInstance \"o\" Shape \"sphere\"");
  ASSERT_EQ(scene.shapes.size(), 3U);
  EXPECT_EQ(scene.shapes[0].group, 0);
  EXPECT_EQ(scene.shapes[1].group, 0);
  EXPECT_EQ(scene.shapes[2].group, scene::kNone);
  expect_near(center_of(scene, 0), {1, 0, 0});
  ASSERT_EQ(scene.instances.size(), 2U);
  EXPECT_EQ(scene.instances[0].group, 0);
  EXPECT_EQ(scene.instances[0].to_world[7], 5);
}

TEST(PbrtDirectives, FilesAreIncludedAndImported) {
  const Directory directory;
  directory.write("parts/a.pbrt", "Translate 1 0 0\nShape \"sphere\"\n");
  const auto included = load_pbrt(directory, pbrt_around("Include \"parts/a.pbrt\" "
                                                         "Shape \"sphere\""));
  ASSERT_TRUE(included);
  expect_near(center_of(included.value(), 1), {1, 0, 0});
  const auto imported = load_pbrt(directory, pbrt_around("Import \"parts/a.pbrt\" "
                                                         "Shape \"sphere\""));
  ASSERT_TRUE(imported);
  expect_near(center_of(imported.value(), 0), {1, 0, 0});
  expect_near(center_of(imported.value(), 1), {0, 0, 0});
}

TEST(PbrtDirectives, ErrorsInIncludedFilesNameThem) {
  const Directory directory;
  directory.write("a.pbrt", "\nShape \"sphere\" \"float radius\" [ -1 ]\n");
  const auto scene = load_pbrt(directory, pbrt_around("Include \"a.pbrt\""));
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().to_string(), "a.pbrt:2: parameter \"radius\" must be greater than 0");
}

TEST(PbrtDirectives, FilesOutsideTheRootAreRefused) {
  const Directory outside;
  outside.write("secret.pbrt", "Shape \"sphere\"");
  const Directory directory;
  const std::string name = (outside.path() / "secret.pbrt").string();
  for (const std::string_view directive : {"Include", "Import"}) {
    const auto scene =
        load_pbrt(directory, pbrt_around(std::string(directive) + " \"" + name + "\""),
                  {.root = directory.path()});
    ASSERT_FALSE(scene);
    EXPECT_TRUE(contains(scene.error().message, "outside")) << scene.error().message;
  }
}

TEST(PbrtDirectives, AFileThatIncludesItselfEnds) {
  EXPECT_TRUE(contains(pbrt_error("WorldBegin Include \"scene.pbrt\""), "WorldBegin"));
  EXPECT_TRUE(contains(pbrt_error("Include \"scene.pbrt\""), "include each other"));
}

TEST(PbrtDirectives, AttributesGiveDefaultParameters) {
  const auto scene = valid_pbrt(
      "Attribute \"shape\" \"float radius\" 3 Shape \"sphere\" "
      "Shape \"sphere\" \"float radius\" 2");
  EXPECT_EQ(std::get<scene::Sphere>(scene.shapes[0].geometry).radius, 3);
  EXPECT_EQ(std::get<scene::Sphere>(scene.shapes[1].geometry).radius, 2);
}

TEST(PbrtDirectives, MistakesAreNamedWithLineAndRemedy) {
  EXPECT_EQ(pbrt_error("WorldBegin\nSheap \"sphere\"")
                .find("scene.pbrt:2: expected a directive "
                      "such as Shape, found \"Sheap\"; did "
                      "you mean \"Shape\"?"),
            0U);
  struct Case {
    const char* text;
    const char* message;
  };
  for (const Case& c : {
           Case{"WorldBegin\nAttributeEnd", "2: AttributeEnd without AttributeBegin"},
           Case{"WorldBegin\nAttributeBegin\nShape \"sphere\"",
                "2: AttributeBegin is never closed"},
           Case{"Shape \"sphere\"", "1: Shape must stand after WorldBegin"},
           Case{"WorldBegin\nFilm \"rgb\"", "2: Film must stand before WorldBegin"},
           Case{"Translate 1 2", "3 numbers; found the end of the file after 2"},
           Case{"Translate 1 two 3", "found \"two\" after 1"},
           Case{"WorldBegin\nShape \"sphere", "2: a string must be closed"},
           Case{"WorldBegin\nShape \"sphere\" \"radius\" 1", "\"type name\""},
           Case{"WorldBegin\nShape \"sphere\" \"flaot radius\" 1", "did you mean \"float\"?"},
           Case{"WorldBegin\nShape \"sphere\" \"float radius\" [1", "a ] is missing"},
           Case{"WorldBegin\nShape \"sphere\" \"float radius\" [1 2]", "must have one value"},
           Case{"WorldBegin\nShape \"sphere\" \"float radius\" x", "must be a finite number"},
           Case{"WorldBegin\nShape \"sphere\" \"float r\" 1\n\"float r\" 1", "3: parameter"},
           Case{"WorldBegin\nShape \"sphere\" \"float raduis\" 1", "did you mean \"radius\"?"},
           Case{"WorldBegin\nShape \"spere\"", "did you mean \"sphere\"?"},
           Case{"WorldBegin\nMaterial \"matte\" Shape \"sphere\"", "use \"diffuse\""},
           Case{"WorldBegin\nObjectInstance \"x\"", "no object is named \"x\""},
           Case{"WorldBegin\nNamedMaterial \"x\" Shape \"sphere\"", "no material is named \"x\""},
           Case{"WorldBegin\nMakeNamedMedium \"m\"", "2: participating media"},
           Case{"MediumInterface \"\" \"m\"", "1: participating media"},
           Case{"Shape", "WorldBegin"},
           Case{"", "no WorldBegin"},
       }) {
    const std::string error = pbrt_error(c.text);
    EXPECT_TRUE(contains(error, c.message)) << c.text << "\n-> " << error;
  }
}

TEST(PbrtDirectives, LeniencyDropsMediaAndUnknownThings) {
  const auto scene = valid_pbrt(
      "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" MediumInterface \"m\" \"\"\n"
      "Material \"hair\" Shape \"sphere\" \"float wobble\" 3 Shape \"curve\"",
      "", {.lenient = true});
  EXPECT_EQ(scene.shapes.size(), 1U);
  EXPECT_EQ(scene.warnings.size(), 5U);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
