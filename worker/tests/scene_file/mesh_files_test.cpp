// OBJ and PLY: what is in the file, in which order, and vertex normals. Expected normals were read
// from Mitsuba 3.9.1 for the same files.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "scene_file/affine.h"
#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

using Floats = std::vector<float>;
using Indices = std::vector<uint32_t>;

constexpr std::string_view kFourVertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\n";
const Floats kFourPositions = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0.5};
const Floats kFourNormals = {0.22705F, -0.22705F, 0.94705F, 0,        0,         1,
                             0.22705F, -0.22705F, 0.94705F, 0.40825F, -0.40825F, 0.8165F};

scene::TriangleMesh load_mesh(const std::string& file, std::string_view content,
                              const std::string& parameters = "") {
  const Directory directory;
  directory.write(file, content);
  const std::string type = file.substr(file.find('.') + 1);
  const auto scene = load_text(
      directory, scene_around("<shape type=\"" + type + "\"><string name=\"filename\" value=\"" +
                              file + "\"/>" + parameters + "</shape>"));
  EXPECT_TRUE(scene) << scene.error().to_string();
  return scene ? first_mesh(scene.value()) : scene::TriangleMesh{};
}

scene::TriangleMesh load_obj(const std::string& rest, const std::string& parameters = "") {
  return load_mesh("m.obj", std::string(kFourVertices) + rest, parameters);
}

void expect_near(const Floats& actual, const Floats& expected, float tolerance = 1e-5F) {
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t i = 0; i < actual.size(); ++i) EXPECT_NEAR(actual[i], expected[i], tolerance) << i;
}

const std::string kFaceNormals = "<boolean name=\"face_normals\" value=\"true\"/>";
const std::string kMirror = "<transform name=\"to_world\"><scale x=\"-1\" y=\"2\"/></transform>";

TEST(Obj, ComputesAngleWeightedNormals) {
  const auto mesh = load_obj("f 1 2 3\nf 1 3 4\n");
  EXPECT_EQ(mesh.positions, kFourPositions);
  EXPECT_EQ(mesh.indices, (Indices{0, 1, 2, 0, 2, 3}));
  expect_near(mesh.normals, kFourNormals);
  EXPECT_TRUE(mesh.texcoords.empty());
}

TEST(Obj, CutsPolygonsIntoFans) {
  EXPECT_EQ(load_obj("f 1 2 3 4\n").indices, (Indices{0, 1, 2, 0, 2, 3}));
  EXPECT_EQ(load_obj("v 9 9 9\nf 1 2 3 4 5\n").indices, (Indices{0, 1, 2, 0, 2, 3, 0, 3, 4}));
}

TEST(Obj, ReadsNormalsAndSharesVertices) {
  const auto mesh =
      load_obj("vn 0 0 2\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//2 3//2 4//2\nf 1//1 3//1 4//2");
  EXPECT_EQ(mesh.positions, (Floats{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0.5}));
  EXPECT_EQ(mesh.normals, (Floats{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 1, 0}));
  EXPECT_EQ(mesh.indices, (Indices{0, 1, 2, 3, 4, 5, 0, 2, 5}));
}

TEST(Obj, CompletesMissingNormals) {
  const auto mesh = load_obj("vn 0 1 0\nf 1//1 2//1 3//1\nf 1 2 3\n");
  EXPECT_EQ(mesh.normals, (Floats{0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1}));
}

TEST(Obj, FaceNormalsDropVertexNormals) {
  EXPECT_TRUE(load_obj("vn 0 0 2\nf 1//1 2//1 3//1\n", kFaceNormals).normals.empty());
}

TEST(Obj, FlipsTextureCoordinatesUnlessTold) {
  const std::string file = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 0.25\nf 1/1 2/2 3/3\nf 1/1/ 3/3 4/4\n";
  EXPECT_EQ(load_obj(file).texcoords, (Floats{0, 1, 1, 1, 1, 0, 0, 0.75}));
  EXPECT_EQ(load_obj(file, "<boolean name=\"flip_tex_coords\" value=\"false\"/>").texcoords,
            (Floats{0, 0, 1, 0, 1, 1, 0, 0.25}));
}

TEST(Obj, MirrorsLikeMitsuba) {
  const auto computed = load_obj("f 1 2 3\nf 1 3 4\n", kMirror);
  EXPECT_EQ(computed.positions, (Floats{0, 0, 0, -1, 0, 0, -1, 2, 0, 0, 2, 0.5}));
  EXPECT_EQ(computed.indices, (Indices{0, 1, 2, 0, 2, 3}));
  expect_near(computed.normals, {0.14354F, 0.07177F, -0.98704F, 0, 0, -1, 0.32017F, 0.16008F,
                                 -0.93374F, 0.43644F, 0.21822F, -0.87287F});
  const auto given =
      load_obj("vn 0 0 2\nvn 0.6 0.8 0\nf 1//1 2//1 3//1\nf 1//2 3//2 4//2\n", kMirror);
  expect_near(given.normals, {0, 0, 1, 0, 0, 1, 0, 0, 1, -0.83205F, 0.5547F, 0, -0.83205F, 0.5547F,
                              0, -0.83205F, 0.5547F, 0});
  // Reversed, so that the winding agrees with the normals of the file.
  EXPECT_EQ(given.indices, (Indices{0, 2, 1, 3, 5, 4}));
}

TEST(Obj, AcceptsWhatExportersWrite) {
  const auto mesh =
      load_mesh("m.obj",
                "# comment\r\nmtllib a.mtl\r\no thing\r\n\r\nv 0 0 0 1 1 1\r\n"
                "v\t+1.0e+0 0 0 # inline\r\nv 0 1 0\r\ng group\r\nusemtl m\r\ns off\r\n"
                "l 1 2\r\nf -3 -2 -1\r\n");
  EXPECT_EQ(mesh.positions, (Floats{0, 0, 0, 1, 0, 0, 0, 1, 0}));
  EXPECT_EQ(mesh.indices, (Indices{0, 1, 2}));
}

TEST(Obj, UnusableVerticesGetAUnitNormal) {
  const auto mesh = load_obj("f 1 2 3\nf 4 4 4\n");
  EXPECT_EQ(Floats(mesh.normals.end() - 3, mesh.normals.end()), (Floats{1, 0, 0}));
}

std::string ply_header(const std::string& format, const std::string& vertex_properties, int faces) {
  return "ply\nformat " + format + " 1.0\ncomment made by hand\nelement vertex 4\n" +
         vertex_properties + "element face " + std::to_string(faces) +
         "\nproperty list uchar int vertex_indices\nend_header\n";
}

const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";

TEST(Ply, ReadsText) {
  const auto mesh = load_mesh(
      "m.ply", ply_header("ascii", kXyz, 2) + "0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n3 0 1 2\n3 0 2 3\n");
  EXPECT_EQ(mesh.positions, kFourPositions);
  EXPECT_EQ(mesh.indices, (Indices{0, 1, 2, 0, 2, 3}));
  expect_near(mesh.normals, kFourNormals);
}

TEST(Ply, ReadsQuadsNormalsTexcoordsAndSkipsTheRest) {
  const std::string file =
      ply_header("ascii",
                 kXyz +
                     "property uchar red\nproperty float nx\nproperty float ny\nproperty float nz\n"
                     "property list uchar float weights\nproperty float s\nproperty float t\n",
                 1) +
      "0 0 0 255 0 0 2 0 0 0\n1 0 0 0 0 0 2 1 0.5 1 0\n1 1 0 0 0 0 2 2 1 2 1 1\n"
      "0 1 0.5 0 0 0 2 0 0 0.25\n4 0 1 2 3\n";
  const auto mesh = load_mesh("m.ply", file);
  EXPECT_EQ(mesh.indices, (Indices{0, 1, 2, 0, 2, 3}));
  EXPECT_EQ(mesh.normals, (Floats{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}));
  EXPECT_EQ(mesh.texcoords, (Floats{0, 0, 1, 0, 1, 1, 0, 0.25}));
  EXPECT_EQ(
      load_mesh("m.ply", file, "<boolean name=\"flip_tex_coords\" value=\"true\"/>").texcoords,
      (Floats{0, 1, 1, 1, 1, 0, 0, 0.75}));
  EXPECT_TRUE(load_mesh("m.ply", file, kFaceNormals).normals.empty());
}

template <class T>
void put(std::string& bytes, T value, bool big_endian) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big)) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

TEST(Ply, ReadsBothByteOrders) {
  for (const bool big_endian : {false, true}) {
    std::string file = ply_header(big_endian ? "binary_big_endian" : "binary_little_endian",
                                  "property double x\nproperty float y\nproperty float z\n", 1);
    for (size_t i = 0; i < 4; ++i) {
      put<double>(file, kFourPositions[3 * i], big_endian);
      put<float>(file, kFourPositions[3 * i + 1], big_endian);
      put<float>(file, kFourPositions[3 * i + 2], big_endian);
    }
    put<uint8_t>(file, 4, big_endian);
    for (int32_t i = 0; i < 4; ++i) put<int32_t>(file, i, big_endian);
    const auto mesh = load_mesh("m.ply", file);
    EXPECT_EQ(mesh.positions, kFourPositions);
    EXPECT_EQ(mesh.indices, (Indices{0, 1, 2, 0, 2, 3}));
  }
}

TEST(Ply, ReadsAttributesOfVerticesAndFaces) {
  const std::string file =
      "ply\nformat ascii 1.0\nelement vertex 4\n" + kXyz +
      "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float heat_a\n"
      "property float alone\nelement face 1\nproperty list uchar int vertex_indices\n"
      "property float r\nproperty float g\nproperty float b\nend_header\n"
      "0 0 0 255 0 51 1 9\n1 0 0 255 0 0 2 9\n1 1 0 255 0 0 3 9\n0 1 0 255 0 0 4 9\n"
      "4 0 1 2 3 0.1 0.2 0.3\n";
  const auto mesh = load_mesh("m.ply", file);
  ASSERT_EQ(mesh.attributes.size(), 3U);
  EXPECT_EQ(mesh.attributes[0].name, "vertex_color");
  EXPECT_EQ(mesh.attributes[0].channels, 3);
  EXPECT_FLOAT_EQ(mesh.attributes[0].values.at(2), 0.2F);
  EXPECT_EQ(mesh.attributes[1].name, "vertex_heat");
  EXPECT_EQ(mesh.attributes[1].values, (Floats{1, 2, 3, 4}));
  EXPECT_EQ(mesh.attributes[2].name, "face_color");
  EXPECT_TRUE(mesh.attributes[2].per_face);
  // One polygon became two triangles.
  EXPECT_EQ(mesh.attributes[2].values, (Floats{0.1F, 0.2F, 0.3F, 0.1F, 0.2F, 0.3F}));
}

// ---- ply files that are keys of a mesh that deforms ----

std::string flat_ply(int vertices, const std::string& height) {
  std::string file = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(vertices) +
                     "\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
                     "property list uchar int vertex_indices\nend_header\n";
  for (int i = 0; i < vertices; ++i)
    file += std::to_string(i % 2) + " " + std::to_string(i / 2) + " " + height + "\n";
  return file + "3 0 1 2\n";
}

std::string deformable(const std::string& files, const std::string& times) {
  return "<shape type=\"deformable\">\n<string name=\"filename\" value=\"" + files +
         "\"/>\n<string name=\"times\" value=\"" + times + "\"/></shape>";
}

Point face_normal(const scene::TriangleMesh& mesh) {
  const auto corner = [&](size_t i) {
    const float* p = &mesh.positions.at(3 * size_t{mesh.indices.at(i)});
    return Point{p[0], p[1], p[2]};
  };
  return normalized(cross(subtract(corner(1), corner(0)), subtract(corner(2), corner(0))));
}

// Normals are carried by the inverse transpose of the pose, which does not know of windings.
TEST(Ply, IsTurnedOverByAMirrorThatComesLaterAsByOneAtOnce) {
  const Directory directory;
  directory.write("m.ply", flat_ply(4, "3"));
  const std::string ply = "<shape type=\"ply\"><string name=\"filename\" value=\"m.ply\"/>";
  const std::string keys =
      "<shape type=\"deformable\"><string name=\"filename\" value=\"m.ply, m.ply\"/>"
      "<string name=\"times\" value=\"0, 1\"/>";
  for (const std::string mirror : {"1", "-1"}) {
    const std::string pose = "<scale x=\"" + mirror + "\" y=\"2\"/><rotate y=\"1\" angle=\"70\"/>";
    const std::string still = "<transform name=\"to_world\">" + pose + "</transform></shape>";
    const std::string moving = "<animation name=\"to_world\"><transform time=\"0\">" + pose +
                               "</transform><transform time=\"1\">" + pose +
                               "<translate x=\"1\"/></transform></animation></shape>";
    for (const std::string& more : {std::string(), kFaceNormals}) {
      const auto there = load_text(directory, scene_around(ply + more + still));
      ASSERT_TRUE(there) << there.error().to_string();
      const scene::TriangleMesh& expected = first_mesh(there.value());
      for (const std::string& type : {ply, keys}) {
        const auto here = load_text(directory, scene_around(type + more + moving));
        ASSERT_TRUE(here) << here.error().to_string();
        const scene::TriangleMesh& mesh = first_mesh(here.value());
        const scene::Motion& motion = here.value().shapes[0].motion;
        ASSERT_EQ(motion.keys.size(), 2U);
        const Matrix carry = normal_matrix(motion.keys[0].to_world);
        const Point face = normalized(transform_point(carry, face_normal(mesh)));
        for (size_t k = 0; k < 3; ++k)
          EXPECT_NEAR(face[k], face_normal(expected)[k], 1e-6) << mirror << more;
        ASSERT_EQ(mesh.normals.size(), expected.normals.size());
        for (size_t i = 0; i < mesh.normals.size(); i += 3) {
          // Vertex 3 is in no face: any normal will do.
          if (i / 3 == 3) continue;
          const Point n = normalized(
              transform_point(carry, {mesh.normals[i], mesh.normals[i + 1], mesh.normals[i + 2]}));
          for (size_t k = 0; k < 3; ++k)
            EXPECT_NEAR(n[k], expected.normals[i + k], 1e-6) << mirror << more;
        }
      }
    }
  }
}

TEST(Deformable, IsMadeOfItsFilesInTheOrderOfTime) {
  const Directory directory;
  directory.write("a.ply", flat_ply(4, "1"));
  directory.write("b.ply", flat_ply(4, "5"));
  const auto scene = load_text(directory, scene_around(deformable("b.ply, a.ply", "2 0.5")));
  ASSERT_TRUE(scene.ok()) << scene.error().to_string();
  const scene::Shape& shape = scene.value().shapes[0];
  EXPECT_EQ(shape.key_times, (std::vector<double>{0.5, 2}));
  const auto& mesh = std::get<scene::TriangleMesh>(shape.geometry);
  ASSERT_EQ(mesh.keys.size(), 2U);
  EXPECT_EQ(mesh.keys[0].positions[2], 1);
  EXPECT_EQ(mesh.keys[1].positions[2], 5);
  EXPECT_EQ(mesh.positions, mesh.keys[0].positions);
}

TEST(Deformable, Errors) {
  const Directory directory;
  directory.write("a.ply", flat_ply(4, "1"));
  directory.write("b.ply", flat_ply(5, "5"));
  const auto error = [&](const std::string& files, const std::string& times) {
    return error_of(directory, deformable(files, times));
  };
  const std::string usage =
      "scene.xml:2: shape \"deformable\" needs a \"filename\" with two or more ply files between "
      "commas, and \"times\" with as many numbers";
  EXPECT_EQ(error("a.ply", "0"), usage);
  EXPECT_EQ(error("a.ply, a.ply", "0"), usage);
  EXPECT_EQ(error("a.ply, a.ply", "0, x"), usage);
  EXPECT_EQ(error("a.ply, a.ply", "1, 1"),
            "scene.xml:4: two files of shape \"deformable\" have the same time");
  EXPECT_NE(error("a.ply, b.ply", "0, 1").find("has other vertices or faces than"),
            std::string::npos)
      << error("a.ply, b.ply", "0, 1");
}

// Two faces of a roof that meet at a right angle.
TEST(Obj, MaxSmoothAngleSplitsSharpEdges) {
  const std::string roof = "v 2 0 0\nv 2 1 0\nv 3 0 1\nv 1 0 1\nf 5 6 8\nf 5 7 6\n";
  const auto angle = [](const std::string& degrees) {
    return "<float name=\"max_smooth_angle\" value=\"" + degrees + "\"/>";
  };
  EXPECT_EQ(load_obj(roof, angle("60")).normals.size(), 3 * 6U);
  EXPECT_EQ(load_obj(roof, angle("120")).normals.size(), 3 * 4U);
}

}  // namespace
}  // namespace metrofarm::scene_file::test
