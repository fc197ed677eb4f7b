// Reads the mesh files of a scene after its other parts, in several threads: what a shape gets
// doesn't depend on their number. A file that several shapes name is read and parsed once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "scene_file/file_access.h"
#include "scene_file/mesh.h"

namespace metrofarm::scene_file {

enum class MeshFormat { kObj, kPly, kSerialized };

// A mesh file that a shape is made of.
struct MeshRequest {
  std::filesystem::path file;
  MeshFormat format = MeshFormat::kObj;
  int64_t shape_index = 0;  // serialized files only
  MeshOptions options = {};
  size_t shape = 0;      // index into the scene's shapes
  // Of a mesh that deforms: the keys of one shape are requested one after the other, from 0 on.
  std::optional<size_t> key = {};
  SourceLocation where;  // of the file's name
  std::string name;      // of the shape, for progress
};

class MeshQueue {
 public:
  // Called from the thread that calls load, now and then: how many requests are done, and what
  // comes next.
  using Progress = std::function<void(size_t done, const std::string& name)>;

  void add(MeshRequest request, const FileAccess& files);
  size_t size() const { return requests_.size(); }

  // Sets the geometry of every shape that was asked for. The error is that of the first request
  // that fails, in the order of their addition; it lies in the mesh file.
  std::optional<Error> load(const FileAccess& files, std::vector<scene::Shape>& shapes,
                            const Progress& progress);

 private:
  struct Source;  // a file, its content and who still needs it

  Result<scene::TriangleMesh> load_mesh(size_t request, const FileAccess& files) const;
  std::optional<Error> join_keys(std::vector<scene::TriangleMesh>& meshes,
                                 std::vector<scene::Shape>& shapes) const;

  std::vector<MeshRequest> requests_;
  std::vector<std::shared_ptr<Source>> sources_;  // of each request
  std::map<std::pair<std::filesystem::path, MeshFormat>, std::shared_ptr<Source>> known_;
};

}  // namespace metrofarm::scene_file
