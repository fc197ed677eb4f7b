#include "base/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <new>
#include <thread>
#include <vector>

namespace metrofarm {
namespace {

TEST(ParallelFor, CallsEveryIndexOnce) {
  for (int threads : {1, 4}) {
    std::vector<std::atomic<int>> calls(1000);
    parallel_for(calls.size(), threads, [&](size_t i, int) { ++calls[i]; });
    for (const auto& n : calls) ASSERT_EQ(n, 1);
  }
}

TEST(ParallelFor, ThrowsWhatAnyThreadThrows) {
  for (int threads : {1, 4}) {
    std::atomic<int> calls = 0;
    const auto work = [&](size_t i, int) {
      ++calls;
      if (i == 10) throw std::bad_alloc();
      // Lest the others are through before the one that throws is heard.
      if (i > 10) std::this_thread::sleep_for(std::chrono::microseconds(100));
    };
    EXPECT_THROW(parallel_for(100000, threads, work), std::bad_alloc);
    EXPECT_LT(calls, 100000) << "nothing new is begun";
  }
}

}  // namespace
}  // namespace metrofarm
