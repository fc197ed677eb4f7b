// Scene bundles on disk and loaded scenes in memory, both found again by content.
#pragma once

#include <filesystem>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>

#include "base/result.h"
#include "metrofarm/scene/v1/scene.pb.h"
#include "rpc/convert.h"
#include "transport/scene.h"

namespace metrofarm::rpc {

// Receives a bundle piece by piece and puts it in place when it is whole and every digest is right.
class BundleWriter {
 public:
  // directory: where the bundle ends up; written beside it until then.
  explicit BundleWriter(std::filesystem::path directory);
  ~BundleWriter();

  // Empty on success, else what is wrong. Order: manifest, then data in manifest order.
  std::string begin(const metrofarm::scene::v1::BundleManifest& manifest,
                    const std::string& expected_digest);
  std::string append(std::string_view data);
  std::string finish();

 private:
  std::string open_next();
  std::string close_current();

  struct Impl;
  std::filesystem::path directory_, partial_;
  std::unique_ptr<Impl> impl_;
};

// True for the relative paths that bundles may hold: see BundleFile.path.
bool is_safe_bundle_path(const std::string& path);

struct LoadedScene {
  std::unique_ptr<transport::Scene> scene;
  LoadTimes times;
};

// Keeps the most recently used scenes. Thread-safe.
class SceneCache {
 public:
  using Fetch = std::function<std::string(const std::string& digest, BundleWriter& writer)>;
  using Progress = std::function<void(double fraction, std::string_view activity)>;

  SceneCache(std::filesystem::path directory, std::string isa, Fetch fetch);

  // Loads the scene unless it is there. The error names files relative to the bundle.
  Result<std::shared_ptr<const LoadedScene>> get(const metrofarm::scene::v1::SceneRef& ref,
                                                 const Progress& progress);
  // Forgets loaded scenes, in case memory is to blame.
  void clear();

 private:
  Result<std::shared_ptr<const LoadedScene>> load(const metrofarm::scene::v1::SceneRef& ref,
                                                  const Progress& progress);

  std::filesystem::path directory_;
  std::string isa_;
  Fetch fetch_;
  std::mutex mutex_;
  std::list<std::pair<std::string, std::shared_ptr<const LoadedScene>>> scenes_;
};

}  // namespace metrofarm::rpc
