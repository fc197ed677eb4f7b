// Runs independent pieces of work on a fixed number of threads.
#pragma once

#include <cstddef>
#include <functional>

namespace metrofarm {

// Calls work(index, thread) once for every index in [0, count), on `threads` threads including the
// caller's, each with denormals flushed to zero (part of the renderer's arithmetic). Indices are
// handed out in ascending order; which thread gets which is unspecified. Returns when all are done.
// What work throws (std::bad_alloc) is thrown again here, once all threads have stopped; indices
// that were not begun by then are left out.
void parallel_for(size_t count, int threads,
                  const std::function<void(size_t index, int thread)>& work);

// Flushes denormals to zero on the calling thread while alive.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned saved_;
};

}  // namespace metrofarm
