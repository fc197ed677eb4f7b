#include <gtest/gtest.h>

#include <numbers>

#include "motion/track.h"
#include "scene_file/affine.h"
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

// A disk that moves as the content of its <animation> says.
scene::Motion motion_of(const std::string& keys, const std::string& attributes = "") {
  const auto scene = load_valid("<shape type=\"disk\"><animation name=\"to_world\"" + attributes +
                                ">" + keys + "</animation></shape>");
  EXPECT_EQ(std::get<scene::Disk>(scene.shapes.at(0).geometry).to_world, kIdentity);
  return scene.shapes.at(0).motion;
}

TEST(Animation, IsReadInTheOrderOfTime) {
  const scene::Motion motion = motion_of(
      "<transform time=\"0.5\"><translate x=\"2\"/></transform>"
      "<transform time=\"0\"><rotate z=\"1\" angle=\"400\"/><translate x=\"1\"/></transform>");
  ASSERT_EQ(motion.keys.size(), 2U);
  EXPECT_EQ(motion.keys[0].time, 0);
  EXPECT_EQ(motion.keys[1].time, 0.5);
  EXPECT_EQ(motion.keys[1].to_world[3], 2);
  ASSERT_EQ(motion.keys[0].turns.size(), 1U);
  EXPECT_EQ(motion.keys[0].turns[0].degrees, 400);
  EXPECT_EQ(motion.path, scene::MotionPath::kLinear);
}

TEST(Animation, PathsMayBeCurved) {
  const std::string keys =
      "<transform time=\"0\" out=\"1, 2, 3\"><translate x=\"1\"/></transform>"
      "<transform time=\"1\"><translate x=\"2\"/></transform>";
  const scene::Motion bezier = motion_of(keys, " interpolation=\"bezier\"");
  EXPECT_EQ(bezier.path, scene::MotionPath::kBezier);
  EXPECT_EQ(bezier.keys[0].out, (scene::Point{1, 2, 3}));
  EXPECT_EQ(bezier.keys[1].in, (scene::Point{2, 0, 0}));  // where the key itself is
  const scene::Motion smooth =
      motion_of("<transform time=\"0\"/><transform time=\"1\"/>", " interpolation=\"catmullrom\"");
  EXPECT_EQ(smooth.path, scene::MotionPath::kCatmullRom);
}

// Steps after a turn that keep angles carry its axis along; whole turns stay whole turns.
TEST(Animation, WholeTurnsAreKeptUnderLaterSteps) {
  const auto turns_of = [](const std::string& later) {
    const scene::Motion motion =
        motion_of("<transform time=\"0\">" + later +
                  "</transform><transform time=\"1\"><rotate z=\"1\" angle=\"720\"/>" + later +
                  "</transform>");
    return motion.keys.at(1).turns;
  };
  const std::pair<const char*, scene::Point> steps[] = {
      {"<lookat origin=\"1, 2, 3\" target=\"5, 2, 3\" up=\"0, 1, 0\"/>", {1, 0, 0}},
      {"<matrix value=\"0 0 2 1  0 2 0 0  -2 0 0 0  0 0 0 1\"/>", {1, 0, 0}},
      {"<scale value=\"3\"/><translate x=\"7\"/>", {0, 0, 1}},
      {"<scale z=\"-1\"/>", {0, 0, 1}},
      {"<scale x=\"-1\"/>", {0, 0, -1}},
  };
  for (const auto& [later, axis] : steps) {
    const auto turns = turns_of(later);
    ASSERT_EQ(turns.size(), 1U) << later;
    EXPECT_EQ(turns[0].degrees, 720) << later;
    for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(turns[0].axis[i], axis[i], 1e-9) << later;
  }
  EXPECT_TRUE(turns_of("<scale x=\"2\"/>").empty()) << "stretched, a turn is no turn";
}

// Two turns about y between other steps: after a quarter of the time half of one.
TEST(Animation, WholeTurnsAmongOtherStepsAreMade) {
  const auto key = [](const char* time, const char* degrees, const std::string& before,
                      const std::string& after) {
    return "<transform time=\"" + std::string(time) + "\">" + before + "<rotate y=\"1\" angle=\"" +
           degrees + "\"/>" + after + "</transform>";
  };
  const std::pair<const char*, const char*> around[] = {
      {"", "<lookat origin=\"1, 2, 3\" target=\"5, 2, 4\" up=\"0, 1, 0\"/>"},
      {"", "<matrix value=\"0 0 2 1  0 2 0 0  -2 0 0 0  0 0 0 1\"/>"},
      {"", "<matrix value=\"0.70710678 -0.70710678 0  0.70710678 0.70710678 0  0 0 1\"/>"},
      {"<rotate x=\"1\" angle=\"90\"/><scale x=\"1\" y=\"2\" z=\"3\"/>", ""},
  };
  for (const auto& [before, after] : around) {
    const scene::Motion motion =
        motion_of(key("0", "0", before, after) + key("1", "720", before, after));
    const motion::Track track(motion);
    EXPECT_EQ(track.moving().size(), 1U) << before << after;
    EXPECT_NEAR(track.turning_during({0, 1}), 4 * std::numbers::pi, 1e-5) << before << after;
    const scene::Motion half =
        motion_of(key("0", "180", before, after) + key("1", "180", before, after));
    const Matrix there = half.keys[0].to_world, found = track.at(0.25);
    for (size_t i = 0; i < 12; ++i) EXPECT_NEAR(found[i], there[i], 1e-5) << before << after << i;
  }
}

// Where turns that are told are not followed, a warning says so, once.
TEST(Animation, LostTurnsAreTold) {
  const auto warnings_of = [](const std::string& keys) {
    const auto scene = load_valid("<shape type=\"disk\">\n<animation name=\"to_world\">" + keys +
                                  "</animation></shape>");
    std::string all;
    for (const Error& warning : scene.warnings) all += warning.message + "\n";
    return all;
  };
  const std::string still = "<transform time=\"0\"><rotate z=\"1\" angle=\"0\"/></transform>";
  const auto turned = [](const std::string& steps) {
    return "<transform time=\"1\"><rotate z=\"1\" angle=\"720\"/>" + steps + "</transform>";
  };
  EXPECT_EQ(warnings_of(still + turned("")), "");
  EXPECT_EQ(warnings_of(still + turned("<translate x=\"1\"/>")), "");
  const std::string shorter =
      "an angle of this <animation> changes by more than half a turn from one <transform> to the "
      "next, but the shorter way is taken; to go all of it, both must have the same <rotate> "
      "steps, with one angle alone that differs\n";
  EXPECT_EQ(warnings_of("<transform time=\"0\"/>" + turned("")), shorter);
  EXPECT_EQ(warnings_of(still + turned("<rotate x=\"1\" angle=\"20\"/>")), shorter);
  EXPECT_EQ(warnings_of(still + turned("<scale x=\"2\"/>")),
            "whole turns before a step that stretches are not followed\n");
}

TEST(Animation, OfOneKeyIsATransform) {
  const auto scene = load_valid(R"(<shape type="disk"><animation name="to_world">
<transform time="0"><translate x="1"/></transform></animation></shape>)");
  EXPECT_TRUE(scene.shapes[0].motion.empty());
  EXPECT_EQ(std::get<scene::Disk>(scene.shapes[0].geometry).to_world[3], 1);
}

TEST(Animation, MovesLightsButNotEnvironments) {
  const std::string keys =
      "<animation name=\"to_world\"><transform time=\"0\"/><transform time=\"1\">"
      "<translate x=\"1\"/></transform></animation></emitter>";
  for (const char* type : {"point", "spot", "directional"}) {
    const auto scene = load_valid("<emitter type=\"" + std::string(type) + "\">" + keys);
    EXPECT_EQ(scene.emitters.at(0).motion.keys.size(), 2U) << type;
  }
  EXPECT_EQ(
      error_of("<shape type=\"shapegroup\" id=\"g\"><shape type=\"disk\">\n"
               "<animation name=\"to_world\"><transform time=\"0\"/><transform time=\"1\"/>"
               "</animation></shape></shape><shape type=\"instance\"><ref id=\"g\"/></shape>"),
      "scene.xml:3: parameter \"to_world\" of shape \"disk\" cannot be an <animation>: this "
      "does not move by itself");
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
  EXPECT_EQ(animation("<transform time=\"1\"><scale z=\"0\"/></transform><transform time=\"2\"/>"),
            "scene.xml:3: the transforms of what moves must not flatten it");
  EXPECT_EQ(animation("<transform time=\"1\"/><transform time=\"2\"><scale x=\"-1\"/></transform>"),
            "scene.xml:3: what moves must not be mirrored from one key to the next");
  EXPECT_EQ(animation("<transform time=\"1\" in=\"1, 2, 3\"/>"),
            "scene.xml:4: in= and out= of a <transform> need <animation interpolation=\"bezier\">");
  EXPECT_EQ(error_of("<shape type=\"disk\">\n<animation name=\"to_world\" "
                     "interpolation=\"cubic\"><transform time=\"0\"/></animation></shape>"),
            "scene.xml:3: unknown interpolation \"cubic\" of an <animation>; supported: linear, "
            "catmullrom, bezier");
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
