#include "rpc/scene_cache.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "rpc/sha256.h"

namespace metrofarm::rpc {
namespace {

namespace fs = std::filesystem;

// Scenes of as many cubes as are asked for, none like another.
class SceneCacheTest : public testing::Test {
 protected:
  SceneCacheTest() {
    directory_ = fs::temp_directory_path() / ("metrofarm-scene-cache-" + std::to_string(getpid()));
    fs::remove_all(directory_);
    fs::create_directories(directory_);
  }
  ~SceneCacheTest() override {
    std::error_code ignored;
    fs::remove_all(directory_, ignored);
  }

  SceneCache cache(uint64_t scene_memory) {
    SceneCacheOptions options;
    options.directory = directory_;
    options.scene_memory = scene_memory;
    options.isa = "avx2";
    return {options, metrics_, log_};
  }

  // Loads a scene of 1000 cubes; `before` is called while it is fetched.
  SceneCache::Scene load(SceneCache& cache, const std::function<void()>& before) {
    std::string xml =
        R"(<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>)";
    for (int i = 0; i < 1000; ++i) xml += R"(<shape type="cube"/>)";
    xml += "<!-- " + std::to_string(++scenes_) + " --></scene>";
    scene::v1::BundleManifest manifest;
    auto& file = *manifest.add_files();
    file.set_path("scene.xml");
    file.set_size(xml.size());
    file.set_sha256(sha256_hex(xml));
    metrofarm::scene::v1::SceneRef ref;
    ref.set_entry("scene.xml");
    ref.set_bundle_digest(
        sha256_hex(file.sha256() + " " + std::to_string(xml.size()) + " scene.xml\n"));
    const auto fetch = [&](const std::string& digest, BundleWriter& writer, std::string& problem) {
      before();
      problem = writer.begin(manifest, digest);
      if (problem.empty()) problem = writer.append(xml);
      if (problem.empty()) problem = writer.finish();
      return CallResult::kDone;
    };
    SceneCache::Scene scene;
    const auto fault = cache.get(ref, fetch, [](double, std::string_view) {}, scene);
    EXPECT_FALSE(fault) << fault->message;
    return scene;
  }
  SceneCache::Scene load(SceneCache& cache) {
    return load(cache, [] {});
  }

  // Whether a scene that nobody uses is still there while the next one is loaded.
  bool stays(SceneCache& cache) {
    const std::weak_ptr<const LoadedScene> first = load(cache);
    EXPECT_FALSE(first.expired());
    bool stayed = false;
    load(cache, [&] { stayed = !first.expired(); });
    return stayed;
  }

  fs::path directory_;
  int scenes_ = 0;
  Metrics metrics_{"test", "avx2", 1};
  Log log_{"test", LogFormat::kText, [](std::string_view) {}};
};

TEST_F(SceneCacheTest, AScenePassesItsMemoryOnToTheNext) {
  auto large = cache(uint64_t{1} << 30);
  const uint64_t bytes = load(large)->scene().bytes().total();
  auto tight = cache(bytes * 19 / 10);
  EXPECT_FALSE(stays(tight)) << "two of them would take more than the memory for scenes";
}

TEST_F(SceneCacheTest, ASceneStaysWhereThereIsRoom) {
  auto large = cache(uint64_t{1} << 30);
  EXPECT_TRUE(stays(large));
}

}  // namespace
}  // namespace metrofarm::rpc
