#include "rpc/scene_cache.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <map>
#include <new>

#include "scene_file/load.h"

namespace metrofarm::rpc {

namespace fs = std::filesystem;
using metrofarm::scene::v1::SceneRef;

namespace {

constexpr size_t kScenes = 3;

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

// Names files as in the bundle.
class BundleNames {
 public:
  explicit BundleNames(const fs::path& bundle) {
    std::error_code ignored;
    prefixes_ = {bundle.string() + "/", fs::weakly_canonical(bundle, ignored).string() + "/"};
  }

  void shorten(SourceLocation& where) const {
    for (const std::string& prefix : prefixes_)
      if (where.file.starts_with(prefix)) where.file.erase(0, prefix.size());
  }
  void shorten(Error& error) const {
    shorten(error.where);
    for (const std::string& prefix : prefixes_) {
      for (size_t at; (at = error.message.find(prefix)) != std::string::npos;)
        error.message.erase(at, prefix.size());
    }
  }
  // In all that reports tell of it.
  void shorten(metrofarm::scene::SceneDescription& scene) const {
    for (Error& warning : scene.warnings) shorten(warning);
    for (auto& shape : scene.shapes) shorten(shape.where);
    for (auto& instance : scene.instances) shorten(instance.where);
    for (auto& emitter : scene.emitters) shorten(emitter.where);
  }

 private:
  std::array<std::string, 2> prefixes_;
};

}  // namespace

LoadedScene::LoadedScene(metrofarm::scene::SceneDescription description, std::string_view isa,
                         uint64_t max_bytes)
    : max_bytes_(max_bytes),
      scene_(std::make_shared<transport::Scene>(std::move(description), isa, max_bytes)) {}

std::shared_ptr<const transport::Scene> LoadedScene::during(
    const motion::Interval& interval) const {
  if (scene_->stands_still() || scene_->interval() == interval) return scene_;
  const std::lock_guard lock(mutex_);
  for (auto it = others_.begin(); it != others_.end(); ++it) {
    if ((*it)->interval() != interval) continue;
    others_.splice(others_.begin(), others_, it);
    return others_.front();
  }
  // Room first: frames come one after the other, and each takes about what the last one did.
  constexpr size_t kMostOthers = 2;
  while (others_.size() >= kMostOthers ||
         (!others_.empty() && room() < others_.front()->own_bytes()))
    others_.pop_back();
  auto built = build(interval);
  return others_.emplace_front(std::move(built));
}

// Requires: mutex_. What was kept goes where that makes it fit.
std::shared_ptr<const transport::Scene> LoadedScene::build(const motion::Interval& interval) const {
  for (;;) {
    try {
      auto built = std::make_shared<transport::Scene>(*scene_, interval, room());
      if (built->own_bytes() <= room()) return built;
    } catch (const std::bad_alloc&) {
      if (others_.empty()) throw;
    }
    if (others_.empty()) throw std::bad_alloc();
    others_.pop_back();
  }
}

uint64_t LoadedScene::bytes() const {
  const std::lock_guard lock(mutex_);
  return kept_bytes();
}

// Requires: mutex_.
uint64_t LoadedScene::kept_bytes() const {
  uint64_t bytes = scene_->bytes().total();
  for (const auto& other : others_) bytes += other->own_bytes();
  return bytes;
}

// Requires: mutex_.
uint64_t LoadedScene::room() const {
  return max_bytes_ - std::min(max_bytes_, kept_bytes());
}

SceneCache::SceneCache(SceneCacheOptions options, Metrics& metrics, Log& log)
    : options_(std::move(options)),
      metrics_(metrics),
      bundles_(options_.directory, options_.max_bytes, metrics, log) {}

std::optional<LoadFault> SceneCache::get(const SceneRef& ref, const Fetch& fetch,
                                         const Progress& progress, Scene& scene) {
  const std::lock_guard lock(mutex_);
  const std::string key = key_of(ref);
  for (auto it = scenes_.begin(); it != scenes_.end(); ++it) {
    if (it->key != key) continue;
    scenes_.splice(scenes_.begin(), scenes_, it);
    scene = scenes_.front().scene;
    return std::nullopt;
  }
  shrink(options_.scene_memory / 2, kScenes - 1, 0);
  if (auto fault = load(ref, fetch, progress, scene)) return fault;
  scenes_.push_front({key, scene});
  shrink(options_.scene_memory, kScenes, 1);
  return std::nullopt;
}

std::optional<LoadFault> SceneCache::during(const LoadedScene& scene,
                                            const motion::Interval& interval,
                                            std::shared_ptr<const transport::Scene>& at_that_time) {
  const std::lock_guard lock(mutex_);
  std::optional<LoadFault> fault;
  try {
    at_that_time = scene.during(interval);
  } catch (const std::bad_alloc&) {
    fault = too_large();
    fault->message = "at the job's shutter, beside the scene at its own (" +
                     std::to_string(scene.bytes()) + " bytes), " + fault->message;
  }
  shrink(options_.scene_memory, kScenes, 1);
  return fault;
}

LoadFault SceneCache::too_large() const {
  return {LoadFault::Kind::kWorker,
          "geometry and acceleration structure take more than the worker's " +
              std::to_string(options_.scene_memory) + " bytes of --scene-memory"};
}

// Requires: mutex_. Those used last stay, min_scenes of them whatever they take.
void SceneCache::shrink(uint64_t max_bytes, size_t max_scenes, size_t min_scenes) {
  uint64_t bytes = 0;
  for (const Kept& kept : scenes_) bytes += kept.scene->bytes();
  while (scenes_.size() > min_scenes && (bytes > max_bytes || scenes_.size() > max_scenes)) {
    bytes -= scenes_.back().scene->bytes();
    scenes_.pop_back();
  }
  metrics_.loaded_scenes(scenes_.size(), bytes);
}

std::optional<LoadFault> SceneCache::load(const SceneRef& ref, const Fetch& fetch,
                                          const Progress& progress, Scene& scene) {
  if (!is_safe_bundle_path(ref.entry()))
    return LoadFault{LoadFault::Kind::kScene, "unsafe scene reference '" + ref.entry() + "'"};
  progress(0, "fetching the scene");
  BundleStore::Pin pin;
  const auto fetch_this = [&](BundleWriter& writer, std::string& problem) {
    return fetch(ref.bundle_digest(), writer, problem);
  };
  if (auto fault = bundles_.pin(ref.bundle_digest(), options_.threads, fetch_this, pin))
    return fault;
  scene_file::LoadOptions options;
  options.defaults = {ref.defaults().begin(), ref.defaults().end()};
  options.lenient = ref.lenient();
  options.root = pin.directory;
  options.progress = progress;
  options.max_bytes = options_.scene_memory;
  const auto load_start = std::chrono::steady_clock::now();
  auto description = scene_file::load_scene(pin.directory / ref.entry(), options);
  const BundleNames names(pin.directory);
  if (!description) {
    Error error = description.error();
    names.shorten(error);
    return LoadFault{LoadFault::Kind::kScene, error.to_string()};
  }
  names.shorten(description.value());

  std::shared_ptr<LoadedScene> loaded;
  const double load_seconds = seconds_since(load_start);
  progress(1, "building the acceleration structure");
  const auto build_start = std::chrono::steady_clock::now();
  try {
    loaded = std::make_shared<LoadedScene>(std::move(description.value()), options_.isa,
                                           options_.scene_memory);
  } catch (const std::bad_alloc&) {
    return too_large();
  }
  loaded->times = {load_seconds, seconds_since(build_start)};
  scene = std::move(loaded);
  return std::nullopt;
}

void SceneCache::clear() {
  const std::lock_guard lock(mutex_);
  scenes_.clear();
  metrics_.loaded_scenes(0, 0);
}

}  // namespace metrofarm::rpc
