#include <gtest/gtest.h>

#include <cmath>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

std::string with_transform(const std::string& type, const std::string& steps,
                           const std::string& more = "") {
  return "<shape type=\"" + type + "\">\n<transform name=\"to_world\">" + steps + "</transform>" +
         more + "</shape>";
}

scene::Point vertex(const scene::TriangleMesh& mesh, uint32_t i) {
  return {mesh.positions.at(3 * i), mesh.positions.at(3 * i + 1), mesh.positions.at(3 * i + 2)};
}

// Twice the area vector of a triangle: along its geometric normal.
scene::Point area_vector(const scene::TriangleMesh& mesh, size_t triangle) {
  const scene::Point a = vertex(mesh, mesh.indices.at(3 * triangle));
  const scene::Point b = vertex(mesh, mesh.indices.at(3 * triangle + 1));
  const scene::Point c = vertex(mesh, mesh.indices.at(3 * triangle + 2));
  const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  const double v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
  return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}

double total_area(const scene::TriangleMesh& mesh) {
  double area = 0;
  for (size_t t = 0; t < mesh.indices.size() / 3; ++t) {
    const scene::Point n = area_vector(mesh, t);
    area += std::hypot(n[0], n[1], n[2]) / 2;
  }
  return area;
}

void expect_winding_agrees_with_normals(const scene::TriangleMesh& mesh) {
  for (size_t t = 0; t < mesh.indices.size() / 3; ++t) {
    const scene::Point n = area_vector(mesh, t);
    const uint32_t i = mesh.indices[3 * t];
    EXPECT_GT(n[0] * mesh.normals.at(3 * i) + n[1] * mesh.normals.at(3 * i + 1) +
                  n[2] * mesh.normals.at(3 * i + 2),
              0)
        << "triangle " << t;
  }
}

TEST(Rectangle, SpansTheUnitSquareFacingUpTheZAxis) {
  const auto scene = load_valid("<shape type=\"rectangle\" id=\"r\"/>");
  const scene::TriangleMesh& mesh = first_mesh(scene);
  EXPECT_EQ(mesh.positions, (std::vector<float>{-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0}));
  EXPECT_EQ(mesh.texcoords, (std::vector<float>{0, 0, 1, 0, 0, 1, 1, 1}));
  EXPECT_EQ(mesh.normals, (std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}));
  expect_winding_agrees_with_normals(mesh);
  EXPECT_EQ(total_area(mesh), 4);
  EXPECT_EQ(scene.shapes[0].id, "r");
  EXPECT_EQ(scene.shapes[0].where.line, 2);
}

TEST(Rectangle, KeepsItsSideUnderMirrorsAndFlatScales) {
  for (const char* steps : {"<scale x=\"-1\"/>", "<scale z=\"0\"/>", "<scale x=\"2\" y=\"-3\"/>"}) {
    const auto scene = load_valid(with_transform("rectangle", steps));
    const scene::TriangleMesh& mesh = first_mesh(scene);
    EXPECT_EQ(mesh.normals, (std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1})) << steps;
    expect_winding_agrees_with_normals(mesh);
  }
}

TEST(Cube, HasMitsubasVerticesAndFacesOutwards) {
  const auto scene = load_valid("<shape type=\"cube\"/>");
  const scene::TriangleMesh& mesh = first_mesh(scene);
  ASSERT_EQ(mesh.positions.size(), 72U);
  EXPECT_EQ(mesh.indices.size(), 36U);
  EXPECT_EQ(vertex(mesh, 0), (scene::Point{1, -1, -1}));
  EXPECT_EQ(vertex(mesh, 5), (scene::Point{-1, 1, -1}));
  EXPECT_EQ(vertex(mesh, 10), (scene::Point{1, 1, 1}));
  EXPECT_EQ(vertex(mesh, 14), (scene::Point{-1, 1, 1}));
  EXPECT_EQ(vertex(mesh, 19), (scene::Point{-1, -1, -1}));
  EXPECT_EQ(vertex(mesh, 21), (scene::Point{1, -1, -1}));
  EXPECT_EQ(std::vector<float>(mesh.texcoords.begin(), mesh.texcoords.begin() + 8),
            (std::vector<float>{0, 1, 1, 1, 1, 0, 0, 0}));
  EXPECT_EQ(total_area(mesh), 24);
  expect_winding_agrees_with_normals(mesh);
  for (size_t t = 0; t < 12; ++t) {
    const scene::Point n = area_vector(mesh, t);
    const scene::Point p = vertex(mesh, mesh.indices[3 * t]);
    EXPECT_GT(n[0] * p[0] + n[1] * p[1] + n[2] * p[2], 0) << "triangle " << t;
  }
}

TEST(Cube, NormalsFollowTheInverseTranspose) {
  const auto scene =
      load_valid(with_transform("cube", "<scale x=\"2\" y=\"-1\"/><rotate z=\"1\" angle=\"30\"/>"));
  const scene::TriangleMesh& mesh = first_mesh(scene);
  expect_winding_agrees_with_normals(mesh);
  for (size_t t = 0; t < 12; ++t) {
    const scene::Point n = area_vector(mesh, t);
    const double length = std::hypot(n[0], n[1], n[2]);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(mesh.normals.at(3 * mesh.indices[3 * t] + axis), n[axis] / length, 1e-6);
    }
  }
}

TEST(Sphere, CombinesCenterRadiusAndTransform) {
  const auto scene = load_valid(with_transform(
      "sphere", "<scale value=\"2\"/><translate x=\"1\" y=\"2\" z=\"3\"/>",
      "<point name=\"center\" x=\"1\" y=\"0\" z=\"0\"/><float name=\"radius\" value=\"3\"/>"));
  const auto& sphere = std::get<scene::Sphere>(scene.shapes.at(0).geometry);
  EXPECT_EQ(sphere.center, (scene::Point{3, 2, 3}));
  EXPECT_EQ(sphere.radius, 6);
  EXPECT_FALSE(scene.shapes[0].flip_normals);
}

TEST(Sphere, MirroredSpheresAreSeenFromInside) {
  const std::string flip = "<boolean name=\"flip_normals\" value=\"true\"/>";
  EXPECT_TRUE(load_valid(with_transform("sphere", "<scale x=\"-1\"/>")).shapes.at(0).flip_normals);
  EXPECT_FALSE(
      load_valid(with_transform("sphere", "<scale x=\"-1\"/>", flip)).shapes.at(0).flip_normals);
  EXPECT_TRUE(load_valid(with_transform("sphere", "", flip)).shapes.at(0).flip_normals);
}

TEST(Sphere, MirroredSpheresThatMoveAreSeenFromInsideToo) {
  const std::string flip = "<boolean name=\"flip_normals\" value=\"true\"/>";
  const auto flipped = [](const std::string& steps, const std::string& more) {
    const auto scene =
        load_valid("<shape type=\"sphere\"><animation name=\"to_world\"><transform time=\"0\">" +
                   steps + "</transform><transform time=\"1\">" + steps +
                   "<translate x=\"1\"/></transform></animation>" + more + "</shape>");
    EXPECT_EQ(scene.shapes.at(0).motion.keys.size(), 2U);
    return scene.shapes.at(0).flip_normals;
  };
  for (const std::string mirror :
       {"", "<scale x=\"-1\"/>", "<scale value=\"-2\"/>", "<scale x=\"-1\" y=\"-1\"/>"}) {
    for (const std::string& more : {std::string(), flip}) {
      EXPECT_EQ(flipped(mirror, more),
                load_valid(with_transform("sphere", mirror, more)).shapes.at(0).flip_normals)
          << mirror << more;
    }
  }
}

TEST(Sphere, Errors) {
  const std::string uneven =
      "scene.xml:3: a sphere's to_world must scale equally in all directions; for an ellipsoid use "
      "a mesh";
  EXPECT_EQ(error_of(with_transform("sphere", "<scale x=\"2\"/>")), uneven);
  EXPECT_EQ(error_of(with_transform("sphere", "<scale value=\"0\"/>")), uneven);
  EXPECT_EQ(error_of("<shape type=\"sphere\"><float name=\"radius\" value=\"-1\"/></shape>"),
            "scene.xml:2: the radius of a sphere must be greater than 0");
  EXPECT_EQ(error_of("<shape type=\"sphere\"><point name=\"center\" x=\"1\" y=\"1\"/></shape>"),
            "scene.xml:2: <point> needs x, y and z");
}

TEST(Disk, FlatThirdAxisIsReplaced) {
  const auto scene = load_valid(with_transform("disk", "<scale x=\"2\" y=\"3\" z=\"0\"/>"));
  EXPECT_EQ(std::get<scene::Disk>(scene.shapes.at(0).geometry).to_world,
            (scene::Matrix{2, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}));
  EXPECT_EQ(error_of(with_transform("disk", "<scale x=\"0\"/>")),
            "scene.xml:3: a disk's to_world must not flatten it to a line");
}

TEST(Shapes, GetMitsubasDefaultMaterials) {
  const auto scene =
      load_valid("<shape type=\"sphere\"/><shape type=\"sphere\"><emitter type=\"area\"/></shape>");
  ASSERT_EQ(scene.shapes.size(), 2U);
  EXPECT_EQ(std::get<scene::Diffuse>(scene.bsdfs.at(scene.shapes[0].bsdf).model).reflectance.value,
            (scene::Rgb{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(std::get<scene::Diffuse>(scene.bsdfs.at(scene.shapes[1].bsdf).model).reflectance.value,
            (scene::Rgb{0, 0, 0}));
  EXPECT_EQ(scene.shapes[1].area_emitter, 0);
}

TEST(Shapes, TakeOneMaterialAndOneLight) {
  EXPECT_EQ(
      error_of("<shape type=\"cube\"><bsdf type=\"diffuse\"/>\n<bsdf type=\"diffuse\"/></shape>"),
      "scene.xml:3: shape \"cube\" takes only one bsdf");
  EXPECT_EQ(
      error_of("<shape type=\"cube\"><emitter type=\"area\"/>\n<emitter type=\"area\"/></shape>"),
      "scene.xml:3: shape \"cube\" takes only one emitter");
}

TEST(Shapes, RefuseMedia) {
  EXPECT_EQ(error_of("<medium id=\"fog\" type=\"homogeneous\"/>\n"
                     "<shape type=\"cube\"><ref name=\"interior\" id=\"fog\"/></shape>"),
            "scene.xml:3: participating media are not supported");
}

TEST(Shapes, BoundariesOfDroppedMediaAreInvisible) {
  const auto scene =
      load_valid("<shape type=\"cube\"><medium name=\"interior\" type=\"homogeneous\"/></shape>",
                 {.lenient = true});
  ASSERT_EQ(scene.shapes.size(), 1U);
  EXPECT_TRUE(std::holds_alternative<scene::Null>(scene.bsdfs.at(scene.shapes[0].bsdf).model));
  EXPECT_EQ(scene.warnings.size(), 1U);
}

TEST(Sphere, SurfaceCoordinatesTurnWithIt) {
  const auto scene =
      load_valid(with_transform("sphere", "<scale value=\"3\"/><rotate z=\"1\" angle=\"90\"/>"));
  const auto& sphere = std::get<scene::Sphere>(scene.shapes.at(0).geometry);
  const std::array<double, 9> expected = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  for (int i = 0; i < 9; ++i) EXPECT_NEAR(sphere.rotation[i], expected[i], 1e-15) << i;
}

TEST(Cylinder, CombinesEndsRadiusAndTransform) {
  const auto scene = load_valid(with_transform(
      "cylinder", "<scale value=\"2\"/>",
      "<point name=\"p0\" x=\"1\" y=\"0\" z=\"0\"/><point name=\"p1\" x=\"1\" y=\"0\" z=\"5\"/>"
      "<float name=\"radius\" value=\"3\"/>"));
  EXPECT_EQ(std::get<scene::Cylinder>(scene.shapes.at(0).geometry).to_world,
            (scene::Matrix{6, 0, 0, 2, 0, 6, 0, 0, 0, 0, 10, 0, 0, 0, 0, 1}));
}

TEST(Cylinder, Errors) {
  const std::string uneven =
      "scene.xml:3: a cylinder's to_world must not shear it or scale it unequally across its "
      "axis; for others use a mesh";
  EXPECT_EQ(error_of(with_transform("cylinder", "<scale x=\"2\"/>")), uneven);
  EXPECT_EQ(error_of(with_transform("cylinder", "<matrix value=\"1 0 1 0 1 0 0 0 1\"/>")), uneven);
  EXPECT_EQ(error_of(with_transform("cylinder", "<scale x=\"2\" y=\"2\"/>")), "");
  EXPECT_EQ(error_of("<shape type=\"cylinder\"><float name=\"radius\" value=\"0\"/></shape>"),
            "scene.xml:2: the radius of a cylinder must be greater than 0");
}

constexpr std::string_view kGroup = R"(<shape type="shapegroup" id="g"><shape type="cube"/>
<shape type="merge"><shape type="sphere"/></shape></shape>)";

TEST(Instances, ShareTheShapesOfAGroup) {
  const auto scene = load_valid(std::string(kGroup) + R"(<shape type="rectangle"/>
<shape type="instance"><ref id="g"/></shape>
<shape type="instance"><ref id="g"/><transform name="to_world"><translate x="4"/></transform>
</shape>)");
  ASSERT_EQ(scene.shapes.size(), 3U);
  ASSERT_EQ(scene.instances.size(), 2U);
  EXPECT_EQ(scene.shapes[0].group, scene::kNone);
  EXPECT_EQ(scene.shapes[1].group, 0);
  EXPECT_EQ(scene.shapes[2].group, 0);
  EXPECT_EQ(scene.instances[1].group, 0);
  EXPECT_EQ(scene.instances[1].to_world[3], 4);
}

TEST(Instances, Errors) {
  const auto error = [](const std::string& content) { return error_of(content); };
  EXPECT_EQ(error("<shape type=\"instance\"/>"),
            "scene.xml:2: an instance needs a shapegroup: <ref id=\"...\"/> to a <shape "
            "type=\"shapegroup\">");
  EXPECT_EQ(error("<shape type=\"instance\"><shape type=\"shapegroup\"><shape type=\"cube\">\n"
                  "<emitter type=\"area\"/></shape></shape></shape>"),
            "scene.xml:3: a shape inside a shapegroup cannot be a light");
  EXPECT_EQ(error("<shape type=\"merge\" id=\"a\"><ref id=\"a\"/></shape>"),
            "scene.xml:2: shape \"merge\" contains itself");
}

}  // namespace
}  // namespace metrofarm::scene_file::test
