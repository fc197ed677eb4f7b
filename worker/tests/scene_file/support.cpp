#include "support.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <fstream>

namespace metrofarm::scene_file::test {

namespace fs = std::filesystem;

Directory::Directory() {
  std::string pattern = (fs::temp_directory_path() / "scene_file_test_XXXXXX").string();
  if (!mkdtemp(pattern.data())) throw std::runtime_error("cannot make a directory for the test");
  path_ = fs::canonical(pattern);
}

Directory::~Directory() {
  fs::remove_all(path_);
}

fs::path Directory::write(const std::string& name, std::string_view content) const {
  const fs::path file = path_ / name;
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << content;
  return file;
}

std::string scene_around(std::string_view content, std::string_view version) {
  std::string xml = "<scene version=\"" + std::string(version) + "\">\n" + std::string(content);
  const auto lacks = [&](std::string_view part) {
    return content.find(part) == std::string_view::npos;
  };
  if (lacks("<sensor")) xml += "<sensor type=\"perspective\"/>";
  if (lacks("<emitter") && lacks("<include")) xml += "<emitter type=\"constant\"/>";
  if (lacks("<shape") && lacks("<include")) xml += "<shape type=\"sphere\"/>";
  return xml + "\n</scene>\n";
}

Result<scene::SceneDescription> load_text(const Directory& directory, std::string_view xml,
                                          const LoadOptions& options) {
  return load_scene(directory.write("scene.xml", xml), options);
}

scene::SceneDescription load_valid(std::string_view content, const LoadOptions& options) {
  const Directory directory;
  Result<scene::SceneDescription> scene = load_text(directory, scene_around(content), options);
  EXPECT_TRUE(scene) << scene.error().to_string();
  return scene ? scene.value() : scene::SceneDescription{};
}

std::string error_of(const Directory& directory, std::string_view content,
                     const LoadOptions& options) {
  const auto scene = load_text(directory, scene_around(content), options);
  if (scene) return "";
  std::string message = scene.error().to_string();
  const std::string prefix = directory.path().string() + "/";
  for (size_t at = message.find(prefix); at != std::string::npos; at = message.find(prefix)) {
    message.erase(at, prefix.size());
  }
  return message;
}

std::string error_of(std::string_view content, const LoadOptions& options) {
  const Directory directory;
  return error_of(directory, content, options);
}

const scene::TriangleMesh& first_mesh(const scene::SceneDescription& scene) {
  static const scene::TriangleMesh kNone;
  const auto* mesh = scene.shapes.empty()
                         ? nullptr
                         : std::get_if<scene::TriangleMesh>(&scene.shapes.front().geometry);
  EXPECT_NE(mesh, nullptr);
  return mesh ? *mesh : kNone;
}

}  // namespace metrofarm::scene_file::test
