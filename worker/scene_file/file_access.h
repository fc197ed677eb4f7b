// Finds and reads the files that a scene names, and keeps them inside the bundle.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "scene_file/load.h"
#include "scene_file/memory_budget.h"

namespace metrofarm::scene_file {

using FileBytes = std::shared_ptr<const std::string>;

class FileAccess {
 public:
  // main_file: the scene; names are looked up beside it unless a search directory has them first.
  // options: only its root, file_read, folder_added and max_bytes are looked at.
  FileAccess(const std::filesystem::path& main_file, const LoadOptions& options);

  // Adds a directory (relative ones are beside the main file) that is searched before those already
  // known. An error's location is left to the caller, here and below.
  Result<std::filesystem::path> add_search_directory(std::string_view name);

  // The existing regular file that `name` stands for.
  Result<std::filesystem::path> find(std::string_view name) const;

  // The content of a file.
  Result<FileBytes> read(const std::filesystem::path& file);

  // The two halves of read: tells file_read of a file, and reads one without telling. The latter
  // may be called from several threads at once.
  void announce(const std::filesystem::path& file) const;
  Result<FileBytes> read_unannounced(const std::filesystem::path& file) const;

  // Of what is made from the files. May be used from several threads at once.
  MemoryBudget& memory() const { return memory_; }

 private:
  Result<std::filesystem::path> check_inside_root(const std::filesystem::path& path) const;

  std::vector<std::filesystem::path> directories_;  // searched from the front
  std::filesystem::path root_;                      // canonical, or empty
  std::function<void(const std::filesystem::path&)> file_read_, folder_added_;
  mutable MemoryBudget memory_;
};

}  // namespace metrofarm::scene_file
