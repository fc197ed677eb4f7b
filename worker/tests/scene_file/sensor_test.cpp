// Sensor, film, sampler and integrator. Horizontal angles were read from Mitsuba 3.9.1.
#include <gtest/gtest.h>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

std::string sensor(const std::string& content, const std::string& film = "") {
  return "<sensor type=\"perspective\">\n" + content +
         "\n<film type=\"hdrfilm\"><integer name=\"width\" value=\"200\"/>"
         "<integer name=\"height\" value=\"100\"/>\n" +
         film + "</film></sensor>";
}

double fov_x(const std::string& content) {
  return load_valid(sensor(content)).sensor.fov_x_degrees;
}

TEST(Sensor, DefaultsAreMitsubas) {
  const auto scene = load_valid("<sensor type=\"perspective\"/>");
  EXPECT_NEAR(scene.sensor.fov_x_degrees, 38.184841, 1e-5);
  EXPECT_EQ(scene.sensor.near_clip, 0.01);
  EXPECT_EQ(scene.sensor.far_clip, 10000);
  EXPECT_EQ(scene.film.width, 768);
  EXPECT_EQ(scene.film.height, 576);
  EXPECT_EQ(scene.film.filter, scene::ReconstructionFilter::kGaussian);
  EXPECT_EQ(scene.film.filter_radius, 2);
  EXPECT_EQ(scene.film.filter_stddev, 0.5);
  EXPECT_EQ(scene.integrator.max_depth, -1);
  EXPECT_EQ(scene.integrator.rr_depth, 5);
  EXPECT_EQ(scene.integrator.sample_count, 4);
  EXPECT_FALSE(scene.integrator.hide_emitters);
}

TEST(Sensor, FieldOfViewOnEveryAxis) {
  const std::string fov = "<float name=\"fov\" value=\"40\"/><string name=\"fov_axis\" value=";
  EXPECT_NEAR(fov_x("<integer name=\"fov\" value=\"40\"/>"), 40, 1e-12);
  EXPECT_NEAR(fov_x(fov + "\"x\"/>"), 40, 1e-12);
  EXPECT_NEAR(fov_x(fov + "\"larger\"/>"), 40, 1e-12);
  EXPECT_NEAR(fov_x(fov + "\"y\"/>"), 72.104774, 1e-5);
  EXPECT_NEAR(fov_x(fov + "\"smaller\"/>"), 72.104774, 1e-5);
  EXPECT_NEAR(fov_x(fov + "\"diagonal\"/>"), 36.064789, 1e-5);
  EXPECT_NEAR(fov_x("<string name=\"focal_length\" value=\"50mm\"/>"), 42.311714, 1e-5);
  EXPECT_NEAR(fov_x("<string name=\"focal_length\" value=\"50\"/>"), 42.311714, 1e-5);
}

TEST(Sensor, ReadsTheRest) {
  const auto scene = load_valid(sensor(R"(<float name="near_clip" value="10"/>
<float name="far_clip" value="2800"/><float name="focus_distance" value="1000"/>
<float name="principal_point_offset_x" value="0.1"/>
<float name="principal_point_offset_y" value="-0.2"/>
<transform name="to_world"><scale x="-1"/><translate z="7"/></transform>
<sampler type="multijitter"><integer name="sample_count" value="99"/></sampler>)"));
  EXPECT_EQ(scene.sensor.near_clip, 10);
  EXPECT_EQ(scene.sensor.far_clip, 2800);
  EXPECT_EQ(scene.sensor.principal_point_offset_x, 0.1);
  EXPECT_EQ(scene.sensor.principal_point_offset_y, -0.2);
  EXPECT_EQ(scene.sensor.to_world,
            (scene::Matrix{-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 7, 0, 0, 0, 1}));
  EXPECT_EQ(scene.integrator.sample_count, 99);
  EXPECT_EQ(scene.film.width, 200);
}

TEST(Sensor, Errors) {
  const auto error = [](const std::string& content) { return error_of(sensor(content)); };
  EXPECT_EQ(error("<float name=\"fov\" value=\"180\"/>"),
            "scene.xml:3: fov must lie between 0 and 180 degrees");
  EXPECT_EQ(
      error("<float name=\"fov\" value=\"30\"/><string name=\"focal_length\" value=\"9mm\"/>"),
      "scene.xml:3: give either fov or focal_length, not both");
  EXPECT_EQ(error("<string name=\"focal_length\" value=\"5cm\"/>"),
            "scene.xml:3: focal_length must be a positive number of millimetres such as \"50mm\"");
  EXPECT_EQ(error("<string name=\"fov_axis\" value=\"z\"/>"),
            "scene.xml:3: unknown fov_axis \"z\"; supported: x, y, diagonal, smaller, larger");
  EXPECT_EQ(
      error("<transform name=\"to_world\"><scale value=\"1.01\"/></transform>"),
      "scene.xml:3: the sensor's to_world must only rotate and translate: it scales or shears");
  EXPECT_EQ(error("<float name=\"near_clip\" value=\"10\"/><float name=\"far_clip\" value=\"5\"/>"),
            "scene.xml:2: near_clip must be smaller than far_clip");
  EXPECT_EQ(error("<sampler type=\"sobol\"><integer name=\"sample_count\" value=\"0\"/></sampler>"),
            "scene.xml:3: parameter \"sample_count\" of sampler \"sobol\" must be between 1 and "
            "2147483647, not 0");
  EXPECT_EQ(error_of("<sensor type=\"fisheye\"/>"),
            "scene.xml:2: sensor \"fisheye\" is not supported; supported: perspective, thinlens, "
            "orthographic");
  EXPECT_EQ(load_valid("<sensor type=\"perspective\"/><sensor type=\"perspective\"/>")
                .warnings.at(0)
                .message,
            "the scene has several sensors; the first one is used");
}

TEST(Film, Filters) {
  const auto film = [](const std::string& filter) {
    return load_valid(sensor("", "<rfilter type=" + filter + "</rfilter>")).film;
  };
  EXPECT_EQ(film("\"box\">").filter, scene::ReconstructionFilter::kBox);
  EXPECT_EQ(film("\"box\">").filter_radius, 0.5);
  EXPECT_EQ(film("\"tent\">").filter, scene::ReconstructionFilter::kTent);
  EXPECT_EQ(film("\"tent\">").filter_radius, 1);
  EXPECT_EQ(film("\"tent\"><float name=\"radius\" value=\"2\"/>").filter_radius, 2);
  EXPECT_EQ(film("\"gaussian\"><float name=\"stddev\" value=\"0.75\"/>").filter_radius, 3);
  EXPECT_EQ(film("\"lanczos\">").filter_radius, 3);
  EXPECT_EQ(film("\"catmullrom\">").filter, scene::ReconstructionFilter::kCatmullRom);
  const scene::Film mitchell = film("\"mitchell\"><float name=\"B\" value=\"0.5\"/>");
  EXPECT_EQ(mitchell.filter_radius, 2);
  EXPECT_EQ(mitchell.mitchell_b, 0.5);
  EXPECT_EQ(mitchell.mitchell_c, 1.0 / 3);
  EXPECT_EQ(error_of(sensor("", "<rfilter type=\"sinc\"/>")),
            "scene.xml:5: rfilter \"sinc\" is not supported; supported: box, tent, gaussian, "
            "mitchell, lanczos, catmullrom");
}

TEST(Film, CropWindows) {
  const auto whole = load_valid(sensor("",
                                       "<integer name=\"crop_width\" value=\"200\"/><integer "
                                       "name=\"crop_offset_y\" value=\"0\"/>"))
                         .film;
  EXPECT_EQ(whole.crop.width, 0);
  const auto part = load_valid(sensor("",
                                      "<integer name=\"crop_offset_x\" value=\"150\"/>"
                                      "<integer name=\"crop_height\" value=\"50\"/>"))
                        .film;
  EXPECT_EQ(part.crop.x, 150);
  EXPECT_EQ(part.crop.y, 0);
  EXPECT_EQ(part.crop.width, 50);
  EXPECT_EQ(part.crop.height, 50);
  EXPECT_EQ(part.width, 200);
  EXPECT_EQ(error_of(sensor("", "<integer name=\"crop_height\" value=\"101\"/>")),
            "scene.xml:5: parameter \"crop_height\" of film \"hdrfilm\" must be between 1 and 100, "
            "not 101");
}

TEST(Film, ToneMappingIsLeftOut) {
  const auto scene = load_valid(
      "<sensor type=\"perspective\"><film type=\"ldrfilm\">"
      "<string name=\"tonemap_method\" value=\"reinhard\"/>"
      "<float name=\"gamma\" value=\"2.2\"/></film></sensor>");
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_EQ(scene.warnings[0].message,
            "tone mapping is left out: images are linear (parameter \"tonemap_method\")");
}

TEST(Film, SizeIsLimited) {
  for (const char* width : {"0", "-5", "32769", "99999999999"}) {
    EXPECT_EQ(
        error_of("<sensor type=\"perspective\"><film type=\"hdrfilm\">\n"
                 "<integer name=\"width\" value=\"" +
                 std::string(width) + "\"/></film></sensor>"),
        "scene.xml:3: parameter \"width\" of film \"hdrfilm\" must be between 1 and 32768, not " +
            std::string(width));
  }
}

TEST(Integrator, PathAndDirect) {
  const auto path = load_valid(R"(<integrator type="path"><integer name="max_depth" value="7"/>
<integer name="rr_depth" value="3"/><boolean name="hide_emitters" value="true"/></integrator>)");
  EXPECT_EQ(path.integrator.max_depth, 7);
  EXPECT_EQ(path.integrator.rr_depth, 3);
  EXPECT_TRUE(path.integrator.hide_emitters);
  const auto direct = load_valid("<integrator type=\"direct\"/>");
  EXPECT_EQ(direct.integrator.type, "path");
  EXPECT_EQ(direct.integrator.max_depth, 2);
  EXPECT_TRUE(load_valid("<integrator type=\"volpath\"/>").warnings.empty());
  EXPECT_EQ(error_of("<integrator type=\"path\">\n<integer name=\"max_depth\" value=\"-2\"/>"
                     "</integrator>"),
            "scene.xml:3: parameter \"max_depth\" of integrator \"path\" must be between -1 and "
            "2147483647, not -2");
  EXPECT_EQ(error_of("<integrator type=\"path\"/>\n<integrator type=\"path\"/>"),
            "scene.xml:3: <scene> takes only one integrator");
}

TEST(Integrator, UnknownOnesAreReadAsPathWithAWarning) {
  const auto scene = load_valid(R"(<integrator type="path_sms_ss">
<integer name="max_depth" value="9"/><float name="solver_threshold" value="1"/></integrator>)");
  EXPECT_EQ(scene.integrator.type, "path");
  EXPECT_EQ(scene.integrator.max_depth, 9);
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_EQ(scene.warnings[0].message,
            "integrator \"path_sms_ss\" is not known; it is read as a path integrator");
}

TEST(Integrator, WrappersStandForTheNestedOne) {
  const auto scene = load_valid(R"(<integrator type="moment"><integrator type="path">
<integer name="max_depth" value="2"/></integrator></integrator>)");
  EXPECT_EQ(scene.integrator.max_depth, 2);
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(Sensor, ThinLens) {
  const auto scene = load_valid(
      "<sensor type=\"thinlens\"><float name=\"aperture_radius\" value=\"0.5\"/>"
      "<float name=\"focus_distance\" value=\"7\"/><float name=\"fov\" value=\"40\"/></sensor>");
  EXPECT_EQ(scene.sensor.projection, scene::Projection::kThinLens);
  EXPECT_EQ(scene.sensor.aperture_radius, 0.5);
  EXPECT_EQ(scene.sensor.focus_distance, 7);
  EXPECT_EQ(scene.sensor.fov_x_degrees, 40);
  EXPECT_EQ(error_of("<sensor type=\"thinlens\"/>"),
            "scene.xml:2: a thinlens sensor needs an \"aperture_radius\"");
}

TEST(Sensor, OrthographicMayScale) {
  const auto scene = load_valid(
      "<sensor type=\"orthographic\"><transform name=\"to_world\"><scale x=\"3\" y=\"3\"/>"
      "</transform></sensor>");
  EXPECT_EQ(scene.sensor.projection, scene::Projection::kOrthographic);
  EXPECT_EQ(scene.sensor.to_world[0], 3);
  EXPECT_EQ(error_of("<sensor type=\"orthographic\"><transform name=\"to_world\">\n"
                     "<scale value=\"0\"/></transform></sensor>"),
            "scene.xml:2: the sensor's to_world must not flatten space");
}

TEST(Sensor, KeepsAnimationAndShutter) {
  const auto scene = load_valid(sensor(R"(<float name="shutter_open" value="1"/>
<float name="shutter_close" value="2"/><animation name="to_world">
<transform time="2"><translate x="5"/></transform><transform time="1"><translate x="3"/></transform>
</animation>)"));
  EXPECT_EQ(scene.sensor.shutter_open, 1);
  EXPECT_EQ(scene.sensor.shutter_close, 2);
  ASSERT_EQ(scene.sensor.motion.keys.size(), 2U);
  EXPECT_EQ(scene.sensor.motion.keys[0].time, 1);
  EXPECT_EQ(scene.sensor.motion.keys[1].to_world[3], 5);
  EXPECT_EQ(scene.sensor.to_world[3], 0);
  EXPECT_EQ(error_of(sensor("<float name=\"shutter_close\" value=\"-1\"/>")),
            "scene.xml:2: shutter_close must not be before shutter_open");
}

}  // namespace
}  // namespace metrofarm::scene_file::test
