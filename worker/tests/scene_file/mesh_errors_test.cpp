// Malformed OBJ and PLY files: a clear error, and no memory for what a header only promises.
#include <gtest/gtest.h>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

constexpr std::string_view kWantedBy = " (read for the shape at scene.xml:2)";

std::string mesh_error(const std::string& file, const std::string& content) {
  const Directory directory;
  directory.write(file, content);
  std::string message =
      error_of(directory, "<shape type=\"" + file.substr(file.find('.') + 1) +
                              "\"><string name=\"filename\" value=\"" + file + "\"/></shape>");
  if (message.ends_with(kWantedBy)) message.resize(message.size() - kWantedBy.size());
  return message;
}

std::string obj_error(const std::string& content) {
  return mesh_error("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + content);
}

TEST(ObjErrors, NameTheLine) {
  EXPECT_EQ(obj_error("f 1 2 9\n"),
            "m.obj:4: the face names vertex 9, but the file has defined 3 so far");
  EXPECT_EQ(obj_error("\nf 0 1 2\n"),
            "m.obj:5: the face names vertex 0, but the file has defined 3 so far");
  EXPECT_EQ(obj_error("f -4 1 2\n"),
            "m.obj:4: the face names vertex -4, but the file has defined 3 so far");
  EXPECT_EQ(obj_error("f 1/1 2 3\n"),
            "m.obj:4: the face names texture coordinate 1, but the file has defined 0 so far");
  EXPECT_EQ(obj_error("f 1//1 2 3\n"),
            "m.obj:4: the face names normal 1, but the file has defined 0 so far");
  EXPECT_EQ(obj_error("f 1 2\n"), "m.obj:4: a face needs at least 3 corners");
  EXPECT_EQ(obj_error("f\n"), "m.obj:4: a face needs at least 3 corners");
  EXPECT_EQ(obj_error("f 1 2 x\n"), "m.obj:4: a face corner must look like 1, 1/2, 1//3 or 1/2/3");
  EXPECT_EQ(obj_error("f 1 2 3.5\n"),
            "m.obj:4: a face corner must look like 1, 1/2, 1//3 or 1/2/3");
  EXPECT_EQ(obj_error("f 1 2 99999999999999999999\n"),
            "m.obj:4: a face corner must look like 1, 1/2, 1//3 or 1/2/3");
  EXPECT_EQ(obj_error("v 1 2\n"), "m.obj:4: \"v\" needs 3 numbers");
  EXPECT_EQ(obj_error("vn a b c\n"), "m.obj:4: \"vn\" needs 3 numbers");
  EXPECT_EQ(obj_error("vt\n"), "m.obj:4: \"vt\" needs 1 to 3 numbers");
}

TEST(ObjErrors, MeshesNeedTrianglesAndFiniteNumbers) {
  EXPECT_EQ(obj_error(""), "m.obj: the mesh has no triangles");
  EXPECT_EQ(mesh_error("m.obj", ""), "m.obj: the mesh has no triangles");
  const std::string not_finite =
      "m.obj: a vertex position is not a finite number after the transform";
  EXPECT_EQ(obj_error("v nan 0 0\nf 1 2 4\n"), not_finite);
  EXPECT_EQ(obj_error("v 1e300 0 0\nf 1 2 4\n"), not_finite);
  EXPECT_EQ(obj_error("vt inf 0\nf 1/1 2/1 3/1\n"),
            "m.obj: a texture coordinate is not a finite number");
}

std::string ply_error(const std::string& body, const std::string& format = "ascii",
                      const std::string& vertex =
                          "element vertex 3\nproperty float x\nproperty "
                          "float y\nproperty float z\n",
                      const std::string& face =
                          "element face 1\nproperty list uchar int "
                          "vertex_indices\n") {
  return mesh_error("m.ply",
                    "ply\nformat " + format + " 1.0\n" + vertex + face + "end_header\n" + body);
}

constexpr const char* kVertices = "0 0 0\n1 0 0\n0 1 0\n";

TEST(PlyErrors, InTheHeader) {
  EXPECT_EQ(mesh_error("m.ply", "plx\n"),
            "m.ply:1: not a PLY file: the first line must be \"ply\"");
  EXPECT_EQ(mesh_error("m.ply", "ply\nformat ascii 1.0\n").substr(0, 8), "m.ply:3:");
  EXPECT_EQ(mesh_error("m.ply", "ply\nend_header\n"), "m.ply:2: the header has no \"format\" line");
  EXPECT_EQ(ply_error("", "binary"),
            "m.ply:2: unknown PLY format \"binary\"; supported: ascii, binary_little_endian, "
            "binary_big_endian");
  EXPECT_EQ(ply_error("", "ascii", "element vertex -3\n"),
            "m.ply:3: expected \"element NAME COUNT\"");
  EXPECT_EQ(ply_error("", "ascii", "property float x\n"),
            "m.ply:3: a property must follow an element");
  EXPECT_EQ(ply_error("", "ascii", "element vertex 1\nproperty half x\n"),
            "m.ply:4: unknown PLY property type");
  EXPECT_EQ(ply_error("", "ascii", "elephant\n"),
            "m.ply:3: unknown PLY header keyword \"elephant\"");
  EXPECT_EQ(ply_error("0", "ascii", "element vertex 0\nproperty float x\n"),
            "m.ply:8: the vertices of a PLY file need the properties x, y and z");
  EXPECT_EQ(ply_error(kVertices, "ascii",
                      "element vertex 3\nproperty float x\nproperty float "
                      "y\nproperty float z\n",
                      "element face 0\n"),
            "m.ply:11: the faces of a PLY file need the list property vertex_indices");
}

TEST(PlyErrors, InTheBody) {
  EXPECT_EQ(ply_error(std::string(kVertices) + "3 0 1 7\n"),
            "m.ply: a face names vertex 7, but the file has 3 (numbered from 0)");
  EXPECT_EQ(ply_error(std::string(kVertices) + "3 0 1 -1\n"),
            "m.ply:13: a face has an invalid index");
  EXPECT_EQ(ply_error(std::string(kVertices) + "2 0 1\n"),
            "m.ply:13: a face needs at least 3 corners");
  EXPECT_EQ(ply_error("0 0 0\n1 x 0\n0 1 0\n3 0 1 2\n"),
            "m.ply:11: expected a number in element \"vertex\": the file is damaged or cut short");
  EXPECT_EQ(ply_error(std::string(kVertices) + "3 0 1\n").substr(0, 41),
            "m.ply:14: expected a number in element \"f");
}

TEST(PlyErrors, HeadersThatPromiseTooMuch) {
  for (const char* format : {"ascii", "binary_little_endian"}) {
    const std::string message = ply_error(
        "0 0 0\n", format,
        "element vertex 4000000000000000\nproperty float x\nproperty float y\nproperty float z\n");
    EXPECT_NE(
        message.find("the header promises 4000000000000000 of element \"vertex\", more than the "
                     "file can hold"),
        std::string::npos)
        << message;
  }
  // A list that claims to be longer than the file.
  EXPECT_EQ(
      ply_error(std::string(36, '\0') + std::string("\xff\xff\xff\x7f", 4), "binary_little_endian",
                "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n",
                "element face 1\nproperty list uint int vertex_indices\n"),
      "m.ply: expected a number in element \"face\": the file is damaged or cut short");
}

TEST(PlyErrors, EveryTruncationIsAnErrorOrAMesh) {
  const std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n" +
      std::string(36, '\0') + std::string("\x03\0\0\0\0\x01\0\0\0\x02\0\0\0", 13);
  EXPECT_EQ(mesh_error("m.ply", file), "");
  for (size_t length = 0; length < file.size(); ++length) {
    EXPECT_NE(mesh_error("m.ply", file.substr(0, length)), "") << length;
  }
}

}  // namespace
}  // namespace metrofarm::scene_file::test
