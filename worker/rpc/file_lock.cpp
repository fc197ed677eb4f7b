#include "rpc/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <thread>

namespace metrofarm::rpc {

namespace {

// Whoever had the lock alone may have removed the file meanwhile: then a lock on it means nothing.
bool is_still(const std::filesystem::path& file, int descriptor) {
  struct stat here{}, there{};
  return fstat(descriptor, &here) == 0 && stat(file.c_str(), &there) == 0 &&
         here.st_ino == there.st_ino && here.st_dev == there.st_dev;
}

}  // namespace

FileLock::~FileLock() {
  if (descriptor_ >= 0) close(descriptor_);
}

std::optional<FileLock> FileLock::take(const std::filesystem::path& file, Kind kind,
                                       std::chrono::duration<double> patience) {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + patience;
  for (;;) {
    FileLock lock(open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666));
    if (lock.descriptor_ < 0) return std::nullopt;
    const int operation = (kind == Kind::kShared ? LOCK_SH : LOCK_EX) | LOCK_NB;
    if (flock(lock.descriptor_, operation) == 0 && is_still(file, lock.descriptor_)) return lock;
    if (Clock::now() >= end) return std::nullopt;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

void FileLock::touch() const {
  futimens(descriptor_, nullptr);
}

}  // namespace metrofarm::rpc
