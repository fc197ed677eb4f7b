// Lets one thread end the waiting of another.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <utility>

namespace metrofarm::rpc {

// Ends the call under way and those to come. Thread-safe; one call at a time may use it.
class Cancellation {
 public:
  void cancel() {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
    if (abort_) abort_();
    wake_.notify_all();
  }

  bool cancelled() const {
    const std::lock_guard lock(mutex_);
    return cancelled_;
  }

  // Returns when the time is over, or false when cancelled before.
  bool sleep(std::chrono::duration<double> time) {
    std::unique_lock lock(mutex_);
    return !wake_.wait_for(lock, time, [&] { return cancelled_; });
  }

  // While one lives, cancel() calls abort, at once if it was cancelled before. abort must not
  // return here.
  class Guard {
   public:
    Guard(Cancellation& owner, std::function<void()> abort) : owner_(owner) {
      const std::lock_guard lock(owner_.mutex_);
      owner_.abort_ = std::move(abort);
      if (owner_.cancelled_) owner_.abort_();
    }
    ~Guard() {
      const std::lock_guard lock(owner_.mutex_);
      owner_.abort_ = nullptr;
    }
    Guard(const Guard&) = delete;
    Guard& operator=(const Guard&) = delete;

   private:
    Cancellation& owner_;
  };

 private:
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::function<void()> abort_;
  bool cancelled_ = false;
};

}  // namespace metrofarm::rpc
