#include "base/parallel.h"

#include <immintrin.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace metrofarm {

namespace {
constexpr unsigned kFlushToZero = 0x8000;
constexpr unsigned kDenormalsAreZero = 0x0040;
}  // namespace

FlushDenormals::FlushDenormals() : saved_(_mm_getcsr()) {
  _mm_setcsr(saved_ | kFlushToZero | kDenormalsAreZero);
}

FlushDenormals::~FlushDenormals() {
  _mm_setcsr(saved_);
}

void parallel_for(size_t count, int threads,
                  const std::function<void(size_t index, int thread)>& work) {
  std::atomic<size_t> next{0};
  std::mutex mutex;
  std::exception_ptr failure;
  const auto drain = [&](int thread) {
    const FlushDenormals flush;
    try {
      for (size_t i = next.fetch_add(1); i < count; i = next.fetch_add(1)) work(i, thread);
    } catch (...) {
      next = count;
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> helpers;
    const int wanted =
        static_cast<int>(std::min<size_t>(std::max(threads, 1), std::max<size_t>(count, 1)));
    for (int t = 1; t < wanted; ++t) helpers.emplace_back(drain, t);
    drain(0);
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace metrofarm
