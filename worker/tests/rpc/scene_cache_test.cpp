#include "rpc/scene_cache.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <new>
#include <string>

#include "rpc/sha256.h"
#include "tests/support/scenes.h"

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
    for (int i = 0; i < 1000; ++i) xml += cube_;
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

  // The bytes of a scene of cubes that move, and those of one more shutter.
  struct Sizes {
    uint64_t scene = 0, shutter = 0;
  };
  Sizes moving_cubes() {
    cube_ = R"(<shape type="cube"><animation name="to_world"><transform time="0"/>)"
            R"(<transform time="1"><translate x="1"/></transform></animation></shape>)";
    auto large = cache(uint64_t{1} << 30);
    const SceneCache::Scene scene = load(large);
    const uint64_t alone = scene->bytes();
    std::shared_ptr<const transport::Scene> frame;
    EXPECT_FALSE(large.during(*scene, kFrame, frame));
    return {alone, scene->bytes() - alone};
  }

  static constexpr motion::Interval kFrame = {0.25, 0.5};
  fs::path directory_;
  std::string cube_ = R"(<shape type="cube"/>)";
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

TEST_F(SceneCacheTest, AnotherShutterTakesTheRoomOfOtherScenes) {
  const Sizes sizes = moving_cubes();
  ASSERT_GT(sizes.shutter, 0U);
  auto two = cache(2 * sizes.scene + sizes.shutter / 2);
  const std::weak_ptr<const LoadedScene> first = load(two);
  const SceneCache::Scene second = load(two);
  EXPECT_FALSE(first.expired());
  std::shared_ptr<const transport::Scene> frame;
  const auto fault = two.during(*second, kFrame, frame);
  EXPECT_FALSE(fault) << fault->message;
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->interval(), kFrame);
  EXPECT_TRUE(first.expired());
}

TEST_F(SceneCacheTest, AShutterWithoutRoomBesideItsSceneIsAFault) {
  const Sizes sizes = moving_cubes();
  auto tight = cache(sizes.scene + sizes.shutter / 2);
  const SceneCache::Scene scene = load(tight);
  ASSERT_TRUE(scene);
  std::shared_ptr<const transport::Scene> frame;
  const auto fault = tight.during(*scene, kFrame, frame);
  ASSERT_TRUE(fault);
  EXPECT_EQ(fault->kind, LoadFault::Kind::kWorker);
  EXPECT_NE(fault->message.find("--scene-memory"), std::string::npos) << fault->message;
  EXPECT_FALSE(frame);
  EXPECT_EQ(scene->bytes(), sizes.scene);
}

// A mesh of 2 * across^2 triangles that is bent halfway; the shutter itself is an instant.
scene::SceneDescription bending_sheet(int across) {
  scene::TriangleMesh mesh;
  mesh.keys.resize(3);
  for (int i = 0; i <= across; ++i) {
    for (int j = 0; j <= across; ++j) {
      const auto x = static_cast<float>(i), y = static_cast<float>(j);
      for (float v : {x, y, 0.F}) mesh.positions.push_back(v);
      for (int key = 0; key < 3; ++key)
        for (float v : {x, y, key == 1 ? x * y : 0.F}) mesh.keys[key].positions.push_back(v);
    }
  }
  for (int i = 0; i < across; ++i) {
    for (int j = 0; j < across; ++j) {
      const auto a = static_cast<uint32_t>(i * (across + 1) + j);
      const uint32_t c = a + static_cast<uint32_t>(across) + 1;
      for (uint32_t index : {a, c, a + 1, a + 1, c, c + 1}) mesh.indices.push_back(index);
    }
  }
  test::SceneBuilder b;
  b.shape(std::move(mesh), b.diffuse(0.5F));
  b.description().shapes[0].key_times = {0, 0.3, 1};
  return b.take();
}

// From room for none to room for all that may be kept.
TEST(LoadedScene, ShuttersStayWithinItsMemory) {
  const std::vector<motion::Interval> frames = {{0, 0.4}, {0.1, 0.5}, {0.2, 0.6}, {0.1, 0.9}};
  const LoadedScene free(bending_sheet(20), "avx2", uint64_t{1} << 40);
  const uint64_t alone = free.bytes();
  EXPECT_EQ(alone, free.scene().bytes().total());
  uint64_t largest = 0;
  for (const auto& frame : frames) largest = std::max(largest, free.during(frame)->own_bytes());
  const uint64_t last_two =
      free.during(frames[2])->own_bytes() + free.during(frames[3])->own_bytes();
  EXPECT_EQ(free.bytes(), alone + last_two) << "two are kept";

  int refused = 0, one = 0, two = 0;
  for (int quarters = 2; quarters <= 64; ++quarters) {
    const uint64_t most = alone + largest * static_cast<uint64_t>(quarters) / 4;
    const LoadedScene scene(bending_sheet(20), "avx2", most);
    uint64_t last = 0;
    try {
      for (const auto& frame : frames) last = scene.during(frame)->own_bytes();
    } catch (const std::bad_alloc&) {
      last = 0;
    }
    EXPECT_LE(scene.bytes(), most);
    if (last == 0) ++refused;
    if (last != 0 && scene.bytes() == alone + last) ++one;
    if (last != 0 && scene.bytes() == alone + last_two) ++two;
  }
  EXPECT_GT(refused, 0);
  EXPECT_GT(one, 0);
  EXPECT_GT(two, 0);
  EXPECT_EQ(refused + one + two, 63);
}

}  // namespace
}  // namespace metrofarm::rpc
