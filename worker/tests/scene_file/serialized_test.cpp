#include <gtest/gtest.h>
#include <zlib.h>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

using Floats = std::vector<float>;

constexpr uint32_t kNormals = 1;
constexpr uint32_t kTexcoords = 2;
constexpr uint32_t kColours = 8;
constexpr uint32_t kSingle = 0x1000;
constexpr uint32_t kDouble = 0x2000;

template <class T>
std::string bytes_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

template <class T>
std::string bytes_of(T value) {
  return bytes_of(std::vector<T>{value});
}

std::string compressed(const std::string& text) {
  uLongf size = compressBound(text.size());
  std::string result(size, '\0');
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(result.data()), &size,
                     reinterpret_cast<const Bytef*>(text.data()), text.size()),
            Z_OK);
  result.resize(size);
  return result;
}

std::string mesh_header(uint16_t version, uint32_t flags, uint64_t vertices, uint64_t triangles) {
  return bytes_of(flags) + (version == 4 ? std::string("name\0", 5) : "") + bytes_of(vertices) +
         bytes_of(triangles);
}

// A file with the given uncompressed meshes.
std::string file_of(uint16_t version, const std::vector<std::string>& meshes) {
  std::string file;
  std::string dictionary;
  for (const std::string& mesh : meshes) {
    dictionary += version == 4 ? bytes_of<uint64_t>(file.size())
                               : bytes_of(static_cast<uint32_t>(file.size()));
    file += bytes_of<uint16_t>(0x041C) + bytes_of(version) + compressed(mesh);
  }
  return file + dictionary + bytes_of(static_cast<uint32_t>(meshes.size()));
}

// One triangle whose first vertex is (x, 0, 0).
std::string triangle(uint16_t version, uint32_t flags, double x) {
  const std::vector<double> positions = {x, 0, 0, 1, 0, 0, 0, 1, 0};
  return mesh_header(version, flags, 3, 1) +
         (flags & kDouble ? bytes_of(positions)
                          : bytes_of(Floats(positions.begin(), positions.end()))) +
         bytes_of(std::vector<uint32_t>{0, 1, 2});
}

std::string shape(const std::string& parameters) {
  return "<shape type=\"serialized\"><string name=\"filename\" value=\"m.serialized\"/>\n" +
         parameters + "</shape>";
}

Result<scene::SceneDescription> load(const std::string& file, const std::string& parameters = "") {
  const Directory directory;
  directory.write("m.serialized", file);
  return load_text(directory, scene_around(shape(parameters)));
}

std::string error(const std::string& file, const std::string& parameters = "") {
  const auto scene = load(file, parameters);
  return scene ? "" : scene.error().message.substr(0, scene.error().message.find(" (read for"));
}

scene::TriangleMesh mesh(const std::string& file, const std::string& parameters = "") {
  const auto scene = load(file, parameters);
  EXPECT_TRUE(scene) << scene.error().to_string();
  return scene ? first_mesh(scene.value()) : scene::TriangleMesh{};
}

TEST(Serialized, BothVersionsAndPrecisions) {
  for (const uint16_t version : {uint16_t{3}, uint16_t{4}}) {
    for (const uint32_t flags : {kSingle, kDouble, 0U}) {
      const auto loaded = mesh(file_of(version, {triangle(version, flags, 0)}));
      EXPECT_EQ(loaded.positions, (Floats{0, 0, 0, 1, 0, 0, 0, 1, 0}));
      EXPECT_EQ(loaded.normals, (Floats{0, 0, 1, 0, 0, 1, 0, 0, 1}));
      EXPECT_EQ(loaded.indices, (std::vector<uint32_t>{0, 1, 2}));
    }
  }
}

TEST(Serialized, ShapeIndexChooses) {
  for (const uint16_t version : {uint16_t{3}, uint16_t{4}}) {
    const std::string file =
        file_of(version, {triangle(version, kSingle, 0), triangle(version, kSingle, -5),
                          triangle(version, kSingle, -7)});
    const std::string index = "<integer name=\"shape_index\" value=\"";
    EXPECT_EQ(mesh(file).positions.at(0), 0);
    EXPECT_EQ(mesh(file, index + "1\"/>").positions.at(0), -5);
    EXPECT_EQ(mesh(file, index + "2\"/>").positions.at(0), -7);
    EXPECT_EQ(error(file, index + "3\"/>"),
              "shape_index 3 is out of range: the file holds 3 meshes, numbered from 0");
    EXPECT_NE(error(file, index + "-1\"/>"), "");
  }
}

TEST(Serialized, ReadsNormalsTexcoordsAndColours) {
  const std::string content = mesh_header(4, kSingle | kNormals | kTexcoords | kColours, 3, 1) +
                              bytes_of(Floats{0, 0, 0, 1, 0, 0, 0, 1, 0}) +
                              bytes_of(Floats{0, 2, 0, 0, 2, 0, 0, 2, 0}) +
                              bytes_of(Floats{0, 0, 1, 0, 0, 0.25}) + bytes_of(Floats(9, 0.5F)) +
                              bytes_of(std::vector<uint32_t>{2, 1, 0});
  const auto loaded = mesh(file_of(4, {content}));
  EXPECT_EQ(loaded.normals, (Floats{0, 1, 0, 0, 1, 0, 0, 1, 0}));
  EXPECT_EQ(loaded.texcoords, (Floats{0, 0, 1, 0, 0, 0.25}));
  EXPECT_EQ(loaded.indices, (std::vector<uint32_t>{2, 1, 0}));
  ASSERT_EQ(loaded.attributes.size(), 1U);
  EXPECT_EQ(loaded.attributes[0].name, "vertex_color");
  EXPECT_EQ(loaded.attributes[0].values, Floats(9, 0.5F));
}

TEST(Serialized, FileMayAskForFaceNormals) {
  constexpr uint32_t kFaceNormals = 0x10;
  EXPECT_TRUE(mesh(file_of(4, {triangle(4, kSingle | kFaceNormals, 0)})).normals.empty());
}

TEST(Serialized, DamagedFilesAreErrors) {
  const std::string damaged = "the .serialized file is damaged or cut short";
  EXPECT_EQ(error("nonsense"), "not a Mitsuba .serialized file (its first bytes are wrong)");
  EXPECT_EQ(error(""), "not a Mitsuba .serialized file (its first bytes are wrong)");
  EXPECT_EQ(error(file_of(5, {triangle(4, kSingle, 0)})),
            ".serialized version 5 is not supported; versions 3 and 4 are");
  EXPECT_EQ(error(file_of(4, {triangle(4, kSingle | kDouble, 0)})), damaged);
  EXPECT_EQ(error(file_of(4, {mesh_header(4, kSingle, 3, 1)})), damaged);
  EXPECT_EQ(error(file_of(4, {mesh_header(4, kSingle, 4000000000U, 4000000000U)})), damaged);
  EXPECT_EQ(error(file_of(4, {mesh_header(4, kSingle, UINT64_MAX, 1)})), damaged);
  std::string bad_index = triangle(4, kSingle, 0);
  bad_index[bad_index.size() - 4] = 9;
  EXPECT_EQ(error(file_of(4, {bad_index})), "a triangle names vertex 9, but the mesh has 3");
}

TEST(Serialized, NoTruncationOrFlippedByteCrashes) {
  const std::string file = file_of(4, {triangle(4, kSingle, 0), triangle(4, kDouble, 1)});
  for (size_t i = 0; i < file.size(); ++i) {
    EXPECT_NE(error(file.substr(0, i)), "") << i;
    std::string flipped = file;
    flipped[i] = static_cast<char>(~flipped[i]);
    error(flipped);
  }
}

}  // namespace
}  // namespace metrofarm::scene_file::test
