// Scenes for the tests of the importer: small files in a directory of their own.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "scene_file/load.h"

namespace metrofarm::scene_file::test {

// A directory that is removed at the end of the test.
class Directory {
 public:
  Directory();
  ~Directory();
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;

  // Writes a file (with the directories above it) and returns its path.
  std::filesystem::path write(const std::string& name, std::string_view content) const;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// A scene of version 3.0.0 around the given elements. What stands in `content` begins on line 2. A
// sensor, an emitter and a shape are added after it where it has none.
std::string scene_around(std::string_view content, std::string_view version = "3.0.0");

Result<scene::SceneDescription> load_text(const Directory& directory, std::string_view xml,
                                          const LoadOptions& options = {});

// The scene around `content`; the test fails if it doesn't load.
scene::SceneDescription load_valid(std::string_view content, const LoadOptions& options = {});

// "file:line: message" of the error, with file names relative to the directory; "" if the scene
// around `content` loads.
std::string error_of(const Directory& directory, std::string_view content,
                     const LoadOptions& options = {});
std::string error_of(std::string_view content, const LoadOptions& options = {});

// The first shape, which must be a mesh.
const scene::TriangleMesh& first_mesh(const scene::SceneDescription& scene);

}  // namespace metrofarm::scene_file::test
