#include "scene_file/file_access.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <optional>

namespace metrofarm::scene_file {
namespace {

namespace fs = std::filesystem;

std::string quoted(const fs::path& path) {
  return "\"" + path.string() + "\"";
}

bool is_inside(const fs::path& path, const fs::path& directory) {
  const auto [mismatch, unused] =
      std::mismatch(directory.begin(), directory.end(), path.begin(), path.end());
  static_cast<void>(unused);
  return mismatch == directory.end() || (std::next(mismatch) == directory.end() &&
                                         mismatch->empty());  // "dir/" ends in an empty part
}

fs::path directory_of(const fs::path& file) {
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

}  // namespace

FileAccess::FileAccess(const fs::path& main_file, const LoadOptions& options)
    : directories_{directory_of(main_file)},
      file_read_(options.file_read),
      folder_added_(options.folder_added),
      memory_(options.max_bytes) {
  if (options.root.empty()) return;
  std::error_code error;
  root_ = fs::canonical(options.root, error);
  // A root that doesn't exist holds no file: keep a path that contains nothing.
  if (error) root_ = fs::absolute(options.root, error);
}

Result<fs::path> FileAccess::check_inside_root(const fs::path& path) const {
  if (root_.empty()) return path;
  std::error_code error;
  // Twice: what follows a folder that is not there is resolved by its letters alone at first.
  fs::path resolved = fs::weakly_canonical(path, error);
  if (!error) resolved = fs::weakly_canonical(resolved, error);
  if (error || !is_inside(resolved, root_)) {
    return Error{quoted(path) + " lies outside the scene's directory " + quoted(root_) +
                 "; files must be inside it"};
  }
  return resolved;
}

Result<fs::path> FileAccess::add_search_directory(std::string_view name) {
  fs::path directory(name);
  if (directory.is_relative()) directory = directories_.back() / directory;
  Result<fs::path> inside = check_inside_root(directory);
  if (!inside) return inside;
  std::error_code error;
  const bool may_be_missing = !root_.empty() && !fs::exists(inside.value(), error);
  if (!may_be_missing && !fs::is_directory(inside.value(), error)) {
    return Error{quoted(directory) + " is not a directory"};
  }
  if (folder_added_) folder_added_(directory);
  directories_.insert(directories_.begin(), directory);
  return directory;
}

Result<fs::path> FileAccess::find(std::string_view name) const {
  if (name.empty()) return Error{"the file name is empty"};
  // Exporters on Windows write backslashes.
  std::string with_slashes(name);
  std::replace(with_slashes.begin(), with_slashes.end(), '\\', '/');
  std::string searched;
  std::optional<Error> outside;
  for (const fs::path& directory : directories_) {
    for (const fs::path& variant : {fs::path(name), fs::path(with_slashes)}) {
      const fs::path candidate = directory / variant;
      Result<fs::path> inside = check_inside_root(candidate);
      if (!inside) {
        outside = inside.error();
        continue;
      }
      std::error_code error;
      if (fs::is_regular_file(inside.value(), error)) {
        return root_.empty() ? candidate : inside.value();
      }
    }
    searched += (searched.empty() ? "" : ", ") + quoted(directory);
  }
  if (outside) return *outside;
  return Error{"file " + quoted(fs::path(name)) + " not found; looked in " + searched};
}

Result<FileBytes> FileAccess::read(const fs::path& file) {
  Result<FileBytes> bytes = read_unannounced(file);
  if (bytes) announce(file);
  return bytes;
}

void FileAccess::announce(const fs::path& file) const {
  if (file_read_) file_read_(file);
}

Result<FileBytes> FileAccess::read_unannounced(const fs::path& file) const {
  const Result<fs::path> inside = check_inside_root(file);
  if (!inside) return inside.error();
  std::error_code error;
  const bool regular = fs::is_regular_file(file, error);
  const uintmax_t size = regular ? fs::file_size(file, error) : 0;
  std::ifstream stream;
  if (regular && !error) stream.open(file, std::ios::binary);
  if (!stream.is_open()) return Error{"cannot open " + quoted(file) + " as a regular file"};
  auto bytes = std::make_shared<std::string>(size, '\0');
  stream.read(bytes->data(), static_cast<std::streamsize>(size));
  if (static_cast<uintmax_t>(stream.gcount()) != size) {
    return Error{"cannot read all of " + quoted(file)};
  }
  return FileBytes(std::move(bytes));
}

}  // namespace metrofarm::scene_file
