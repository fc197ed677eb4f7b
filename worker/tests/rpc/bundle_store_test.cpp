#include "rpc/bundle_store.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "rpc/sha256.h"

namespace metrofarm::rpc {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

// A bundle of one file.
struct Bundle {
  std::string content;
  std::string digest;
  scene::v1::BundleManifest manifest;
};

Bundle bundle_of(char letter, size_t bytes) {
  Bundle b;
  b.content = std::string(bytes, letter);
  auto& file = *b.manifest.add_files();
  file.set_path("dir/scene.xml");
  file.set_size(bytes);
  file.set_sha256(sha256_hex(b.content));
  b.digest = sha256_hex(file.sha256() + " " + std::to_string(bytes) + " dir/scene.xml\n");
  return b;
}

class BundleStoreTest : public testing::Test {
 protected:
  BundleStoreTest() {
    directory_ =
        fs::temp_directory_path() / ("metrofarm-store-test-" + std::to_string(getpid()) + "-" +
                                     testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(directory_);
    fs::create_directories(directory_);
  }
  ~BundleStoreTest() override {
    std::error_code ignored;
    fs::remove_all(directory_, ignored);
  }

  // A worker of its own on the shared directory.
  std::unique_ptr<BundleStore> store(uint64_t max_bytes = 1 << 20) {
    return std::make_unique<BundleStore>(directory_, max_bytes, metrics_, log_);
  }

  std::optional<LoadFault> try_pin(BundleStore& store, const Bundle& b, BundleStore::Pin& pin) {
    const auto fetch = [&](BundleWriter& writer, std::string& problem) {
      ++fetched_;
      problem = writer.begin(b.manifest, b.digest);
      if (problem.empty()) problem = writer.append(b.content);
      if (problem.empty()) problem = writer.finish();
      return CallResult::kDone;
    };
    return store.pin(b.digest, 2, fetch, pin);
  }
  std::string pin(BundleStore& store, const Bundle& b, BundleStore::Pin& pin) {
    const auto fault = try_pin(store, b, pin);
    return fault ? "fault: " + fault->message : read(pin.directory / "dir/scene.xml");
  }
  // Uses a bundle for a moment.
  std::string use(BundleStore& s, const Bundle& b) {
    BundleStore::Pin p;
    std::string content = pin(s, b, p);
    std::this_thread::sleep_for(10ms);  // times of files tell which was used last
    return content;
  }

  static std::string read(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  bool there(const Bundle& b) const { return fs::exists(directory_ / b.digest); }

  const Bundle a_ = bundle_of('a', 400 << 10), b_ = bundle_of('b', 400 << 10),
               c_ = bundle_of('c', 400 << 10);
  fs::path directory_;
  Metrics metrics_{"v", "avx2", 1};
  Log log_{"test", LogFormat::kText, [](std::string_view) {}};
  int fetched_ = 0;
};

TEST_F(BundleStoreTest, FetchesOnceAndFindsItAgain) {
  const auto one = store();
  EXPECT_EQ(use(*one, a_), a_.content);
  EXPECT_EQ(use(*one, a_), a_.content);
  EXPECT_EQ(use(*store(), a_), a_.content) << "another process";
  EXPECT_EQ(fetched_, 1);
  EXPECT_GE(one->bytes(), a_.content.size());
}

TEST_F(BundleStoreTest, WhatWasUsedLongestAgoMakesRoom) {
  const auto one = store();
  use(*one, a_);
  use(*one, b_);
  use(*one, a_);  // b is now the oldest
  EXPECT_EQ(use(*one, c_), c_.content);
  EXPECT_TRUE(there(a_));
  EXPECT_FALSE(there(b_));
  EXPECT_TRUE(there(c_));
  EXPECT_LE(one->bytes(), 1U << 20);
}

TEST_F(BundleStoreTest, WhatIsInUseStays) {
  const auto one = store(), other = store();
  BundleStore::Pin in_use;
  pin(*other, a_, in_use);
  use(*one, b_);
  use(*one, c_);
  EXPECT_TRUE(there(a_)) << "the oldest, but in use";
  EXPECT_FALSE(there(b_));
  in_use = {};
  use(*one, b_);
  EXPECT_FALSE(there(a_));
}

TEST_F(BundleStoreTest, ADamagedFileIsFetchedAgain) {
  const auto one = store();
  use(*one, a_);
  const fs::path file = directory_ / a_.digest / "dir/scene.xml";
  std::fstream(file, std::ios::in | std::ios::out | std::ios::binary).seekp(1000).put('x');
  EXPECT_EQ(use(*one, a_), a_.content);
  EXPECT_EQ(fetched_, 2);
  fs::resize_file(file, 100);
  EXPECT_EQ(use(*one, a_), a_.content);
  fs::remove(file);
  EXPECT_EQ(use(*one, a_), a_.content);
  std::ofstream(directory_ / (a_.digest + ".manifest")) << "nonsense";
  EXPECT_EQ(use(*one, a_), a_.content);
  EXPECT_EQ(fetched_, 5);
}

TEST_F(BundleStoreTest, WhatAProcessLeftUnfinishedIsReplaced) {
  fs::create_directories(directory_ / (a_.digest + ".part-1"));
  std::ofstream(directory_ / (a_.digest + ".part-1") / "half") << "half";
  fs::create_directories(directory_ / a_.digest);  // without a manifest
  EXPECT_EQ(use(*store(), a_), a_.content);
  EXPECT_FALSE(fs::exists(directory_ / (a_.digest + ".part-1")));
}

TEST_F(BundleStoreTest, ABundleLargerThanTheCacheIsRefused) {
  const auto one = store(1000);
  const std::string answer = use(*one, a_);
  EXPECT_NE(answer.find("--cache-size"), std::string::npos) << answer;
  EXPECT_FALSE(there(a_));
}

// Writes fail beyond a size while it lives, as on a disk that is full.
class FullDisk {
 public:
  FullDisk() {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit small = before_;
    small.rlim_cur = 1000;
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  void (*handler_)(int) = std::signal(SIGXFSZ, SIG_IGN);  // writes fail instead
  rlimit before_{};
};

TEST_F(BundleStoreTest, AFullDiskIsNotTheScenesFault) {
  const auto one = store();
  std::optional<LoadFault> fault;
  {
    const FullDisk full;
    BundleStore::Pin p;
    fault = try_pin(*one, a_, p);
  }
  ASSERT_TRUE(fault.has_value());
  EXPECT_EQ(fault->kind, LoadFault::Kind::kWorker) << fault->message;
  EXPECT_NE(fault->message.find("cannot write"), std::string::npos) << fault->message;
  EXPECT_FALSE(there(a_));
  EXPECT_EQ(use(*one, a_), a_.content);
}

TEST_F(BundleStoreTest, OnlyDigestsNameBundles) {
  Bundle bad = a_;
  for (const std::string& digest : {std::string("../x"), std::string(64, 'Z'), std::string()}) {
    bad.digest = digest;
    EXPECT_NE(use(*store(), bad).find("unsafe"), std::string::npos) << digest;
  }
}

TEST_F(BundleStoreTest, ACoordinatorThatIsAwayIsNobodysFault) {
  BundleStore::Pin p;
  const auto fault =
      store()->pin(a_.digest, 1, [](BundleWriter&, std::string&) { return CallResult::kAway; }, p);
  ASSERT_TRUE(fault.has_value());
  EXPECT_EQ(fault->kind, LoadFault::Kind::kAway);
}

// Processes that fetch, use and remove each other's bundles for a while: each always reads what it
// asked for.
TEST_F(BundleStoreTest, ProcessesShareTheDirectory) {
  const Bundle* bundles[] = {&a_, &b_, &c_};
  std::vector<pid_t> children;
  for (int process = 0; process < 4; ++process) {
    const pid_t child = fork();
    if (child != 0) {
      children.push_back(child);
      continue;
    }
    const auto one = store();
    bool right = true;
    for (int i = 0; i < 15; ++i) {
      const Bundle& wanted = *bundles[(i * (process + 1) + process) % 3];
      BundleStore::Pin p;
      right = right && pin(*one, wanted, p) == wanted.content;
    }
    _exit(right ? 0 : 1);
  }
  for (pid_t child : children) {
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
}

}  // namespace
}  // namespace metrofarm::rpc
