#include "base/memory.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <string>

namespace metrofarm {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kGibi = uint64_t{1} << 30;

// A machine's files, as far as they say what memory there is.
class Memory : public testing::Test {
 protected:
  void SetUp() override {
    const std::string test = testing::UnitTest::GetInstance()->current_test_info()->name();
    root_ = fs::temp_directory_path() / (test + std::to_string(getpid()));
    fs::create_directories(root_);
  }
  void TearDown() override { fs::remove_all(root_); }

  void write(const fs::path& name, const std::string& content) {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name) << content;
  }
  void machine_of_16_gibi() {
    write("proc/meminfo", "MemFree:  1024 kB\nMemTotal:       16777216 kB\nMemAvailable: 7 kB\n");
  }

  fs::path root_;
};

TEST_F(Memory, IsTheMachinesWhereNothingLimits) {
  machine_of_16_gibi();
  EXPECT_EQ(available_memory(root_), 16 * kGibi);
  write("proc/self/cgroup", "0::/user.slice\n");
  write("sys/fs/cgroup/user.slice/memory.max", "max\n");
  EXPECT_EQ(available_memory(root_), 16 * kGibi);
}

TEST_F(Memory, IsTheContainersWhereItsGroupIsAtTheTop) {
  machine_of_16_gibi();
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/memory.max", "8589934592\n");
  EXPECT_EQ(available_memory(root_), 8 * kGibi);
}

TEST_F(Memory, IsTheSmallestOfTheGroupsAbove) {
  machine_of_16_gibi();
  write("proc/self/cgroup", "0::/farm.slice/worker.service\n");
  write("sys/fs/cgroup/farm.slice/memory.max", "2147483648\n");
  write("sys/fs/cgroup/farm.slice/worker.service/memory.max", "4294967296\n");
  EXPECT_EQ(available_memory(root_), 2 * kGibi);
}

TEST_F(Memory, IsThatOfVersionOne) {
  machine_of_16_gibi();
  write("proc/self/cgroup", "5:cpu,memory:/docker/abc\n1:name=systemd:/docker/abc\n0::/\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  EXPECT_EQ(available_memory(root_), 16 * kGibi) << "a number beyond all memory is no limit";
  write("sys/fs/cgroup/memory/docker/abc/memory.limit_in_bytes", "1073741824\n");
  EXPECT_EQ(available_memory(root_), kGibi);
}

TEST_F(Memory, IsNeverMoreThanTheMachines) {
  machine_of_16_gibi();
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/memory.max", "34359738368\n");
  EXPECT_EQ(available_memory(root_), 16 * kGibi);
}

TEST_F(Memory, IsUnknownWithoutFiles) {
  EXPECT_EQ(available_memory(root_), 0U);
  write("proc/meminfo", "nothing of use\n");
  write("proc/self/cgroup", "neither\n0:\n");
  EXPECT_EQ(available_memory(root_), 0U);
}

TEST_F(Memory, OfThisMachineIsKnown) {
  EXPECT_GT(available_memory(), uint64_t{64} << 20);
}

}  // namespace
}  // namespace metrofarm
