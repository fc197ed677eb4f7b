// Turns a scene file of any supported format into a scene::SceneDescription.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "base/result.h"
#include "scene/description.h"

namespace metrofarm::scene_file {

struct LoadOptions {
  // Values that replace those of the file's <default> elements, by name.
  std::map<std::string, std::string> defaults = {};

  // Unknown plugins, parameters and elements become warnings instead of errors.
  bool lenient = false;

  // Called from the loading thread with what is about to be read; fraction grows from 0 to 1.
  std::function<void(double fraction, std::string_view what)> progress = {};

  // Called with every file that is read, in order; a file may come more than once.
  std::function<void(const std::filesystem::path& file)> file_read = {};

  // Called with every folder that the scene adds to those in which its files are looked for.
  std::function<void(const std::filesystem::path& folder)> folder_added = {};

  // If not empty, every file that is read (the scene file too) and every folder that is looked in
  // must lie inside this directory after symbolic links are resolved. Such a folder need not exist:
  // a bundle has no empty ones.
  std::filesystem::path root = {};

  // Memory that meshes and images may take once decoded, all together. Each file is limited too, in
  // proportion to its size (base/decode_limit.h).
  uint64_t max_bytes = uint64_t{16} << 30;
};

// The importer is chosen by the file's extension. The result has at least one shape, at least one
// emitter that lights the scene, and a sensor; every index in it is valid.
Result<scene::SceneDescription> load_scene(const std::filesystem::path& file,
                                           const LoadOptions& options);

}  // namespace metrofarm::scene_file
