// Locks between processes.
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <utility>

namespace metrofarm::rpc {

// A lock on a file, which is made where it does not exist. Given back when destroyed.
class FileLock {
 public:
  enum class Kind { kShared, kAlone };

  FileLock() = default;
  FileLock(FileLock&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  FileLock& operator=(FileLock&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~FileLock();

  // Nothing if others have it for longer than `patience`, or if the file cannot be made.
  static std::optional<FileLock> take(const std::filesystem::path& file, Kind kind,
                                      std::chrono::duration<double> patience);

  // Sets the file's time to now.
  void touch() const;

 private:
  explicit FileLock(int descriptor) : descriptor_(descriptor) {}
  int descriptor_ = -1;
};

}  // namespace metrofarm::rpc
