#include "scene_file/mesh_queue.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <thread>

#include "scene_file/obj.h"
#include "scene_file/ply.h"
#include "scene_file/serialized.h"

namespace metrofarm::scene_file {

struct MeshQueue::Source {
  std::mutex mutex;
  size_t users = 0;               // requests that have not taken their part yet
  std::optional<Error> error;     // of reading or parsing
  FileBytes bytes;                // serialized files: each mesh is parsed by itself
  std::unique_ptr<RawMesh> mesh;  // the others: parsed once
  bool loaded = false;

  void load(const FileAccess& files, const MeshRequest& request) {
    if (std::exchange(loaded, true)) return;
    Result<FileBytes> read = files.read_unannounced(request.file);
    if (!read) {
      error = read.error();
      return;
    }
    bytes = std::move(read.value());
    if (request.format == MeshFormat::kSerialized) return;
    const std::string name = request.file.string();
    Result<RawMesh> parsed = request.format == MeshFormat::kObj
                                 ? parse_obj(*bytes, name)
                                 : parse_ply(*bytes, name, files.memory().for_file(bytes->size()));
    bytes.reset();
    if (parsed) {
      mesh = std::make_unique<RawMesh>(std::move(parsed.value()));
    } else {
      error = parsed.error();
    }
  }

  // The last user takes the content away.
  Result<RawMesh> take_mesh() {
    const bool last = --users == 0;
    if (error) return *error;
    if (!last) return *mesh;
    return std::move(*std::exchange(mesh, nullptr));
  }

  Result<FileBytes> take_bytes() {
    const bool last = --users == 0;
    if (error) return *error;
    return last ? std::exchange(bytes, nullptr) : bytes;
  }
};

namespace {

// An error inside the file is located there; the message then says which shape wanted it.
Error located(Error error, const MeshRequest& request) {
  if (error.where.file.empty()) error.where.file = request.file.string();
  error.message += " (read for the shape at " + request.where.file + ":" +
                   std::to_string(request.where.line) + ")";
  return error;
}

Result<scene::TriangleMesh> finish(RawMesh raw, const MeshRequest& request,
                                   const FileAccess& files) {
  Result<scene::TriangleMesh> mesh = finish_mesh(std::move(raw), request.options);
  if (!mesh) return mesh;
  if (std::optional<Error> error = files.memory().take(mesh.value())) return *error;
  return mesh;
}

}  // namespace

void MeshQueue::add(MeshRequest request, const FileAccess& files) {
  std::shared_ptr<Source>& source = known_[{request.file, request.format}];
  if (!source) {
    source = std::make_shared<Source>();
    files.announce(request.file);
  }
  ++source->users;
  sources_.push_back(source);
  requests_.push_back(std::move(request));
}

Result<scene::TriangleMesh> MeshQueue::load_mesh(size_t i, const FileAccess& files) const {
  const MeshRequest& request = requests_[i];
  Source& source = *sources_[i];
  std::unique_lock lock(source.mutex);
  source.load(files, request);
  if (request.format != MeshFormat::kSerialized) {
    Result<RawMesh> raw = source.take_mesh();
    lock.unlock();
    return raw ? finish(std::move(raw.value()), request, files) : raw.error();
  }
  const Result<FileBytes> bytes = source.take_bytes();
  lock.unlock();
  if (!bytes) return bytes.error();
  const uint64_t limit = files.memory().for_file(bytes.value()->size());
  Result<RawMesh> raw = parse_serialized(*bytes.value(), request.shape_index, limit);
  return raw ? finish(std::move(raw.value()), request, files) : raw.error();
}

std::optional<Error> MeshQueue::load(const FileAccess& files, std::vector<scene::Shape>& shapes,
                                     const Progress& progress) {
  std::atomic<size_t> next = 0;
  std::atomic<bool> failed = false;
  std::vector<std::optional<Error>> errors(requests_.size());
  std::vector<scene::TriangleMesh> keys(requests_.size());
  const auto work = [&](bool reports) {
    // Whoever has taken a number works on it, so all requests before a failed one are tried.
    while (!failed) {
      const size_t i = next++;
      if (i >= requests_.size()) return;
      if (reports && progress) progress(i, requests_[i].name);
      Result<scene::TriangleMesh> mesh = load_mesh(i, files);
      if (mesh && requests_[i].key) {
        keys[i] = std::move(mesh.value());
      } else if (mesh) {
        shapes[requests_[i].shape].geometry = std::move(mesh.value());
      } else {
        errors[i] = located(mesh.error(), requests_[i]);
        failed = true;
      }
    }
  };
  constexpr size_t kMaxThreads = 8;  // each holds a mesh in the making
  const size_t threads = std::min(
      {kMaxThreads, requests_.size(), size_t{std::max(1U, std::thread::hardware_concurrency())}});
  std::vector<std::thread> others;
  for (size_t i = 1; i < threads; ++i) others.emplace_back(work, false);
  work(true);
  for (std::thread& thread : others) thread.join();
  const auto first = std::find_if(errors.begin(), errors.end(),
                                  [](const auto& error) { return error.has_value(); });
  return first == errors.end() ? join_keys(keys, shapes) : *first;
}

// Makes one mesh of those of its keys.
std::optional<Error> MeshQueue::join_keys(std::vector<scene::TriangleMesh>& meshes,
                                          std::vector<scene::Shape>& shapes) const {
  scene::TriangleMesh* whole = nullptr;
  const MeshRequest* first = nullptr;
  for (size_t i = 0; i < requests_.size(); ++i) {
    const MeshRequest& request = requests_[i];
    if (!request.key) continue;
    scene::TriangleMesh& mesh = meshes[i];
    if (*request.key == 0) {
      first = &request;
      whole = &shapes[request.shape].geometry.emplace<scene::TriangleMesh>(std::move(mesh));
      whole->keys.push_back({whole->positions, whole->normals});
      continue;
    }
    if (mesh.positions.size() != whole->positions.size() || mesh.indices != whole->indices ||
        mesh.normals.size() != whole->normals.size()) {
      return located(Error{"it has other vertices or faces than " + first->file.string() +
                           ": the files of a mesh that deforms must agree in all but positions "
                           "and normals"},
                     request);
    }
    whole->keys.push_back({std::move(mesh.positions), std::move(mesh.normals)});
  }
  return std::nullopt;
}

}  // namespace metrofarm::scene_file
