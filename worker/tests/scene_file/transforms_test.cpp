#include <gtest/gtest.h>

#include "scene_file/motion.h"
#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

std::string disk(const std::string& steps) {
  return "<shape type=\"disk\"><transform name=\"to_world\">\n" + steps + "</transform></shape>";
}

void expect_transform(const std::string& steps, const scene::Matrix& expected) {
  const auto scene = load_valid(disk(steps));
  ASSERT_EQ(scene.shapes.size(), 1U);
  const scene::Matrix& actual = std::get<scene::Disk>(scene.shapes[0].geometry).to_world;
  for (int i = 0; i < 16; ++i) EXPECT_NEAR(actual[i], expected[i], 1e-15) << steps << " at " << i;
}

// Mitsuba 3 puts the axis into the formula of a rotation as it is, older versions make it a unit
// vector.
TEST(Transforms, AnAxisThatIsNotOfUnitLength) {
  expect_transform("<rotate y=\"2\" angle=\"90\"/>",
                   {0, 0, 2, 0, 0, 4, 0, 0, -2, 0, 0, 0, 0, 0, 0, 1});
  const auto scene = load_valid(disk("<rotate y=\"2\" angle=\"90\"/>"));
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_NE(scene.warnings[0].message.find("unit length"), std::string::npos);
  const auto old = load_text(
      Directory{}, scene_around(disk("<rotate value=\"1,1,1\" angle=\"120\"/>"), "0.6.0"));
  ASSERT_TRUE(old.ok());
  const scene::Matrix expected = {0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1};
  const scene::Matrix& actual = std::get<scene::Disk>(old.value().shapes[0].geometry).to_world;
  for (int i = 0; i < 16; ++i) EXPECT_NEAR(actual[i], expected[i], 1e-15) << i;
  EXPECT_TRUE(old.value().warnings.empty());
}

TEST(Transforms, SingleSteps) {
  expect_transform("", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  expect_transform("<translate x=\"1\" z=\"3\"/>",
                   {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 3, 0, 0, 0, 1});
  expect_transform("<translate value=\"1 2, 3\"/>",
                   {1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1});
  expect_transform("<scale value=\"2\"/>", {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1});
  expect_transform("<scale y=\"4\"/>", {1, 0, 0, 0, 0, 4, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  expect_transform("<rotate y=\"1\" angle=\"90\"/>",
                   {0, 0, 1, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 0, 1});
  expect_transform("<matrix value=\"1 2 3 4 5 6 7 8 9 10 12 12 0 0 0 1\"/>",
                   {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 12, 0, 0, 0, 1});
  expect_transform("<matrix value=\"1 2 3, 4 5 6, 7 8 1e+001\"/>",
                   {1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 10, 0, 0, 0, 0, 1});
  expect_transform("<lookat origin=\"0,0,5\" target=\"0,0,0\" up=\"0,1,0\"/>",
                   {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 5, 0, 0, 0, 1});
  // Mitsuba chooses this frame when no up direction is given.
  expect_transform("<lookat origin=\"0,0,5\" target=\"0,0,0\"/>",
                   {0, 1, 0, 0, 1, 0, 0, 0, 0, 0, -1, 5, 0, 0, 0, 1});
}

TEST(Transforms, LaterStepsActAfterEarlierOnes) {
  expect_transform("<translate x=\"1\"/><scale value=\"2\"/>",
                   {2, 0, 0, 2, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1});
  expect_transform("<scale value=\"2\"/><translate x=\"1\"/>",
                   {2, 0, 0, 1, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1});
}

TEST(Animation, IsReadInTheOrderOfTime) {
  const auto scene = load_valid(R"(<shape type="disk"><animation name="to_world">
<transform time="0.5"><translate x="2"/></transform>
<transform time="0"><translate x="1"/></transform></animation></shape>)");
  ASSERT_EQ(scene.shapes.size(), 1U);
  ASSERT_EQ(scene.shapes[0].keys.size(), 2U);
  EXPECT_EQ(scene.shapes[0].keys[0].time, 0);
  EXPECT_EQ(scene.shapes[0].keys[1].time, 0.5);
  EXPECT_EQ(scene.shapes[0].keys[1].to_world[3], 2);
  EXPECT_EQ(std::get<scene::Disk>(scene.shapes[0].geometry).to_world[3], 1);
}

scene::Matrix moving_disk(double shutter_open, const std::string& keys) {
  const auto scene =
      load_valid("<sensor type=\"perspective\"><float name=\"shutter_open\" value=\"" +
                 std::to_string(shutter_open) +
                 "\"/></sensor><shape type=\"disk\"><animation name=\"to_world\">" + keys +
                 "</animation></shape>");
  EXPECT_EQ(scene.shapes.at(0).keys.size(), 2U);
  return std::get<scene::Disk>(scene.shapes.at(0).geometry).to_world;
}

TEST(Animation, StandsWhereItIsWhenTheShutterOpens) {
  const std::string keys =
      "<transform time=\"1\"><scale value=\"2\"/><translate x=\"1\"/></transform>"
      "<transform time=\"3\"><scale value=\"4\"/><rotate z=\"1\" angle=\"90\"/>"
      "<translate x=\"5\" y=\"8\"/></transform>";
  const auto pose = [](double degrees, double scale, double x, double y) {
    return multiply(multiply(translation({x, y, 0}), rotation({0, 0, 1}, degrees)),
                    scaling({scale, scale, scale}));
  };
  const std::pair<double, scene::Matrix> cases[] = {
      {0, pose(0, 2, 1, 0)},  {1, pose(0, 2, 1, 0)},  {1.5, pose(22.5, 2.5, 2, 2)},
      {2, pose(45, 3, 3, 4)}, {3, pose(90, 4, 5, 8)}, {9, pose(90, 4, 5, 8)}};
  for (const auto& [time, expected] : cases) {
    const scene::Matrix actual = moving_disk(time, keys);
    for (int i = 0; i < 16; ++i) EXPECT_NEAR(actual[i], expected[i], 1e-14) << time << " at " << i;
  }
}

// Stretches along axes that are not the coordinates', a mirror, and the shorter of the two arcs.
TEST(Animation, KeysMayShearAndMirror) {
  const std::vector<scene::Matrix> stretches = {
      {2, 1, 0, 0, 1, 3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1},
      {-1, 0, 0, 0, 0, -2, 0, 0, 0, 0, -3, 0, 0, 0, 0, 1}};
  for (const scene::Matrix& stretch : stretches) {
    const std::vector<scene::Keyframe> keys = {
        {0, multiply(rotation({1, 2, 3}, 170), stretch)},
        {1, multiply(rotation({1, 2, 3}, 270), multiply(stretch, scaling({3, 3, 3})))}};
    const scene::Matrix expected =
        multiply(rotation({1, 2, 3}, 195), multiply(stretch, scaling({1.5, 1.5, 1.5})));
    const auto actual = pose_at(keys, 0.25);
    ASSERT_TRUE(actual);
    for (size_t i = 0; i < 16; ++i) EXPECT_NEAR((*actual)[i], expected[i], 1e-13) << i;
  }
  const std::vector<scene::Keyframe> keys = {{0, rotation({0, 1, 0}, 10)},
                                             {1, rotation({0, 1, 0}, 350)}};
  const auto half = pose_at(keys, 0.5);
  ASSERT_TRUE(half);
  for (size_t i = 0; i < 16; ++i) EXPECT_NEAR((*half)[i], kIdentity[i], 1e-15);
}

TEST(Animation, KeysMustNotFlattenWhereAPoseBetweenThemIsShown) {
  const std::vector<scene::Keyframe> keys = {{0, scaling({1, 1, 0})}, {1, translation({1, 0, 0})}};
  EXPECT_FALSE(pose_at(keys, 0.5));
  EXPECT_EQ(pose_at(keys, 0), keys[0].to_world);
  EXPECT_EQ(pose_at(keys, 1), keys[1].to_world);
}

TEST(Animation, Errors) {
  const auto animation = [](const std::string& content) {
    return error_of("<shape type=\"disk\">\n<animation name=\"to_world\">\n" + content +
                    "</animation></shape>");
  };
  EXPECT_EQ(animation(""),
            "scene.xml:3: <animation> needs at least one <transform time=\"SECONDS\">");
  EXPECT_EQ(animation("<transform/>"),
            "scene.xml:4: <animation> takes <transform time=\"SECONDS\"> only");
  EXPECT_EQ(animation("<transform time=\"1\"/><transform time=\"1\"/>"),
            "scene.xml:3: two <transform> of an <animation> have the same time");
}

TEST(Transforms, Errors) {
  EXPECT_EQ(error_of(disk("<matrix value=\"1 2 3\"/>")),
            "scene.xml:3: <matrix> needs 16 (or 9) numbers, row by row");
  EXPECT_EQ(error_of(disk("<matrix value=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 2\"/>")),
            "scene.xml:3: the last row of <matrix> must be 0 0 0 1");
  EXPECT_EQ(error_of(disk("<rotate angle=\"3\"/>")),
            "scene.xml:3: the axis of <rotate> must not be zero; give x=, y= or z=");
  EXPECT_EQ(error_of(disk("<rotate x=\"1\"/>")), "scene.xml:3: <rotate> needs angle=\"DEGREES\"");
  EXPECT_EQ(error_of(disk("<scale x=\"1\" value=\"2\"/>")),
            "scene.xml:3: <scale> takes either value= or x= y= z=, not both");
  EXPECT_EQ(error_of(disk("<translate value=\"1, 2\"/>")),
            "scene.xml:3: \"1, 2\" must be three numbers, as in \"1, 2, 3\", or one for all");
  EXPECT_EQ(
      error_of(disk("<lookat origin=\"0,5,0\" target=\"0,0,0\" up=\"0,1,0\"/>")),
      "scene.xml:3: <lookat> is degenerate: origin and target must differ, and up must not be "
      "parallel to the line of sight");
  EXPECT_EQ(error_of(disk("<lookat origin=\"0,5,0\"/>")),
            "scene.xml:3: <lookat> needs target=\"x, y, z\"");
  EXPECT_EQ(error_of(disk("<float name=\"x\" value=\"1\"/>")),
            "scene.xml:3: <float> is not a step of a <transform>; supported: matrix, translate, "
            "scale, rotate, lookat");
  EXPECT_EQ(error_of(disk("<scale value=\"1e300\"/><scale value=\"1e300\"/>")),
            "scene.xml:2: the transform's numbers are too large");
}

}  // namespace
}  // namespace metrofarm::scene_file::test
