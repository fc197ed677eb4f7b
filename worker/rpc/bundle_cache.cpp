#include "rpc/bundle_cache.h"

#include <unistd.h>

#include <chrono>
#include <fstream>

#include "rpc/sha256.h"
#include "scene_file/load.h"

namespace metrofarm::rpc {

namespace fs = std::filesystem;
using metrofarm::scene::v1::BundleFile;
using metrofarm::scene::v1::BundleManifest;
using metrofarm::scene::v1::SceneRef;

namespace {

// Loaded scenes kept in memory.
constexpr size_t kScenes = 3;

std::string digest_of(const BundleManifest& manifest) {
  Sha256 hash;
  for (const BundleFile& file : manifest.files())
    hash.update(file.sha256() + " " + std::to_string(file.size()) + " " + file.path() + "\n");
  return hash.finish();
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// The same scene under the same key, whatever order the map's entries come in.
std::string key_of(const SceneRef& ref) {
  std::map<std::string, std::string> sorted(ref.defaults().begin(), ref.defaults().end());
  std::string key = ref.bundle_digest() + "\n" + ref.entry() + "\n" + (ref.lenient() ? "1" : "0");
  for (const auto& [name, value] : sorted) key += "\n" + name + "=" + value;
  return key;
}

}  // namespace

bool is_safe_bundle_path(const std::string& path) {
  if (path.empty() || path.size() > 1024 || path.front() == '/') return false;
  if (path.find('\\') != std::string::npos || path.find('\0') != std::string::npos) return false;
  size_t start = 0;
  while (start <= path.size()) {
    const size_t end = std::min(path.find('/', start), path.size());
    const std::string part = path.substr(start, end - start);
    if (part.empty() || part == "." || part == "..") return false;
    start = end + 1;
  }
  return true;
}

struct BundleWriter::Impl {
  BundleManifest manifest;
  int next = 0;  // file to open next
  std::ofstream out;
  std::unique_ptr<Sha256> hash;
  uint64_t left = 0;  // bytes missing from the open file
};

BundleWriter::BundleWriter(fs::path directory)
    : directory_(std::move(directory)),
      partial_(directory_.string() + ".part-" + std::to_string(getpid())),
      impl_(std::make_unique<Impl>()) {}

BundleWriter::~BundleWriter() {
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
}

std::string BundleWriter::begin(const BundleManifest& manifest,
                                const std::string& expected_digest) {
  for (const BundleFile& file : manifest.files()) {
    if (!is_safe_bundle_path(file.path())) return "unsafe path in bundle: '" + file.path() + "'";
  }
  if (digest_of(manifest) != expected_digest) return "the bundle's manifest has another digest";
  impl_->manifest = manifest;
  std::error_code failure;
  fs::remove_all(partial_, failure);
  fs::create_directories(partial_, failure);
  return failure ? "cannot create " + partial_.string() + ": " + failure.message() : "";
}

std::string BundleWriter::open_next() {
  const BundleFile& file = impl_->manifest.files(impl_->next++);
  const fs::path path = partial_ / file.path();
  std::error_code failure;
  fs::create_directories(path.parent_path(), failure);
  impl_->out.open(path, std::ios::binary | std::ios::trunc);
  if (!impl_->out) return "cannot write " + path.string();
  impl_->hash = std::make_unique<Sha256>();
  impl_->left = file.size();
  return impl_->left == 0 ? close_current() : "";
}

std::string BundleWriter::close_current() {
  const BundleFile& file = impl_->manifest.files(impl_->next - 1);
  impl_->out.close();
  if (impl_->out.fail()) return "cannot write " + file.path();
  const bool right = impl_->hash->finish() == file.sha256();
  impl_->hash.reset();
  return right ? "" : "'" + file.path() + "' arrived with another digest than its manifest's";
}

std::string BundleWriter::append(std::string_view data) {
  while (!data.empty()) {
    if (impl_->hash == nullptr) {
      if (impl_->next == impl_->manifest.files_size()) return "more data than the manifest names";
      if (std::string problem = open_next(); !problem.empty()) return problem;
      continue;
    }
    const auto take = static_cast<size_t>(std::min<uint64_t>(impl_->left, data.size()));
    impl_->out.write(data.data(), static_cast<std::streamsize>(take));
    impl_->hash->update(data.substr(0, take));
    impl_->left -= take;
    data.remove_prefix(take);
    if (impl_->left > 0) continue;
    if (std::string problem = close_current(); !problem.empty()) return problem;
  }
  return "";
}

std::string BundleWriter::finish() {
  while (impl_->hash == nullptr && impl_->next < impl_->manifest.files_size()) {
    if (std::string problem = open_next(); !problem.empty()) return problem;
  }
  if (impl_->hash != nullptr) return "the bundle ended early";
  std::error_code failure;
  fs::rename(partial_, directory_, failure);
  // Another worker on this machine may have been first.
  if (failure && !fs::exists(directory_))
    return "cannot create " + directory_.string() + ": " + failure.message();
  return "";
}

SceneCache::SceneCache(fs::path directory, std::string isa, Fetch fetch)
    : directory_(std::move(directory)), isa_(std::move(isa)), fetch_(std::move(fetch)) {}

Result<std::shared_ptr<const LoadedScene>> SceneCache::get(const SceneRef& ref,
                                                           const Progress& progress) {
  const std::lock_guard lock(mutex_);
  const std::string key = key_of(ref);
  for (auto it = scenes_.begin(); it != scenes_.end(); ++it) {
    if (it->first != key) continue;
    scenes_.splice(scenes_.begin(), scenes_, it);
    return scenes_.front().second;
  }
  auto loaded = load(ref, progress);
  if (!loaded) return loaded;
  scenes_.emplace_front(key, loaded.value());
  if (scenes_.size() > kScenes) scenes_.pop_back();
  return loaded;
}

Result<std::shared_ptr<const LoadedScene>> SceneCache::load(const SceneRef& ref,
                                                            const Progress& progress) {
  const fs::path bundle = directory_ / ref.bundle_digest();
  if (!is_safe_bundle_path(ref.bundle_digest()) || !is_safe_bundle_path(ref.entry()))
    return Error{"unsafe scene reference '" + ref.entry() + "'"};
  if (!fs::exists(bundle)) {
    progress(0, "fetching the scene");
    BundleWriter writer(bundle);
    const std::string problem = fetch_(ref.bundle_digest(), writer);
    if (!problem.empty()) return Error{problem};
  }
  scene_file::LoadOptions options;
  options.defaults = {ref.defaults().begin(), ref.defaults().end()};
  options.lenient = ref.lenient();
  options.root = bundle;
  options.progress = progress;
  const auto load_start = std::chrono::steady_clock::now();
  auto description = scene_file::load_scene(bundle / ref.entry(), options);
  const auto relative = [&](Error error) {
    std::error_code ignored;
    const std::string prefix = fs::weakly_canonical(bundle, ignored).string() + "/";
    for (const std::string& p : {bundle.string() + "/", prefix}) {
      if (error.where.file.starts_with(p)) error.where.file.erase(0, p.size());
      for (size_t at; (at = error.message.find(p)) != std::string::npos;)
        error.message.erase(at, p.size());
    }
    return error;
  };
  if (!description) return relative(description.error());
  for (Error& warning : description.value().warnings) warning = relative(warning);

  auto loaded = std::make_shared<LoadedScene>();
  loaded->times.load_seconds = seconds_since(load_start);
  progress(1, "building the acceleration structure");
  const auto build_start = std::chrono::steady_clock::now();
  loaded->scene = std::make_unique<transport::Scene>(std::move(description.value()), isa_);
  loaded->times.build_seconds = seconds_since(build_start);
  return std::shared_ptr<const LoadedScene>(std::move(loaded));
}

void SceneCache::clear() {
  const std::lock_guard lock(mutex_);
  scenes_.clear();
}

}  // namespace metrofarm::rpc
