// Loaded scenes in memory, found again by content.
#pragma once

#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "metrofarm/scene/v1/scene.pb.h"
#include "rpc/bundle_store.h"
#include "rpc/convert.h"
#include "rpc/load_fault.h"
#include "transport/scene.h"

namespace metrofarm::rpc {

// A scene, and the same scene while other shutters than the sensor's own are open: together within
// max_bytes. Thread-safe.
class LoadedScene {
 public:
  LoadedScene(metrofarm::scene::SceneDescription description, std::string_view isa,
              uint64_t max_bytes);

  LoadTimes times;

  // While the sensor's own shutter is open.
  const transport::Scene& scene() const { return *scene_; }
  // All that does not depend on the interval is shared, and so is the rest where nothing moves.
  // Throws std::bad_alloc if there is no room for it beside scene().
  std::shared_ptr<const transport::Scene> during(const motion::Interval& interval) const;
  // Of all that is kept.
  uint64_t bytes() const;

 private:
  std::shared_ptr<const transport::Scene> build(const motion::Interval& interval) const;
  uint64_t kept_bytes() const;
  uint64_t room() const;

  uint64_t max_bytes_;
  std::shared_ptr<const transport::Scene> scene_;
  mutable std::mutex mutex_;
  mutable std::list<std::shared_ptr<const transport::Scene>> others_;  // last used first
};

struct SceneCacheOptions {
  std::filesystem::path directory;          // of the bundles
  uint64_t max_bytes = uint64_t{10} << 30;  // of the bundles
  // That the meshes and images of one scene may take, and all scenes together that are kept.
  uint64_t scene_memory = uint64_t{4} << 30;
  std::string isa;
  int threads = 1;
};

// Keeps the most recently used scenes. Thread-safe.
class SceneCache {
 public:
  // Fetches the bundle `digest`.
  using Fetch = std::function<CallResult(const std::string& digest, BundleWriter& writer,
                                         std::string& problem)>;
  using Progress = std::function<void(double fraction, std::string_view activity)>;
  using Scene = std::shared_ptr<const LoadedScene>;

  SceneCache(SceneCacheOptions options, Metrics& metrics, Log& log);

  // Loads the scene unless it is there. Scenes that are kept then make room: while it is loaded
  // they take half of the memory for scenes at most. Messages name files relative to the bundle.
  std::optional<LoadFault> get(const metrofarm::scene::v1::SceneRef& ref, const Fetch& fetch,
                               const Progress& progress, Scene& scene);
  // A scene that get() has given while another shutter is open, see LoadedScene::during(). Other
  // scenes that are kept make room.
  std::optional<LoadFault> during(const LoadedScene& scene, const motion::Interval& interval,
                                  std::shared_ptr<const transport::Scene>& at_that_time);
  // Forgets loaded scenes, in case memory is to blame.
  void clear();

 private:
  std::optional<LoadFault> load(const metrofarm::scene::v1::SceneRef& ref, const Fetch& fetch,
                                const Progress& progress, Scene& scene);
  LoadFault too_large() const;
  void shrink(uint64_t max_bytes, size_t max_scenes, size_t min_scenes);

  SceneCacheOptions options_;
  Metrics& metrics_;
  BundleStore bundles_;
  std::mutex mutex_;
  struct Kept {
    std::string key;
    Scene scene;
  };
  std::list<Kept> scenes_;  // most recently used first
};

}  // namespace metrofarm::rpc
