// A worker inside the test's process.
#pragma once

#include <grpcpp/security/credentials.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>

#include "rpc/worker.h"
#include "tests/rpc/fake_coordinator.h"

namespace metrofarm::test {

class RunningWorker {
 public:
  explicit RunningWorker(const std::string& coordinators) {
    options.coordinators = rpc::parse_coordinators(coordinators).value();
    options.credentials = grpc::InsecureChannelCredentials();
    options.name = "worker";
    options.version = "v1";
    options.threads = options.scenes.threads = 2;
    options.scenes.isa = "avx2";
    options.scenes.directory = std::filesystem::temp_directory_path() /
                               ("metrofarm-farm-test-" + std::to_string(getpid()));
    options.resolve_seconds = 0.1;
    options.grace_seconds = 3600;  // at its end the process ends, and that is the test's
    std::filesystem::create_directories(options.scenes.directory);
  }
  ~RunningWorker() {
    finish();
    std::error_code ignored;
    std::filesystem::remove_all(options.scenes.directory, ignored);
  }
  RunningWorker(const RunningWorker&) = delete;
  RunningWorker& operator=(const RunningWorker&) = delete;

  void start() {
    thread_ = std::thread([this] {
      code_ = rpc::run_worker(options, log_, [this] { return stop_requests_.load(); });
      ended_ = true;
    });
  }
  void stop() { ++stop_requests_; }
  bool ended() const { return ended_; }
  int finish() {
    stop();
    return wait();
  }
  int wait() {
    if (thread_.joinable()) thread_.join();
    return code_;
  }
  std::string log() const {
    const std::lock_guard lock(mutex_);
    return lines_;
  }

  rpc::WorkerOptions options;

 private:
  mutable std::mutex mutex_;
  std::string lines_;
  Log log_{"worker", LogFormat::kText, [this](std::string_view line) {
             const std::lock_guard lock(mutex_);
             lines_ += line;
           }};
  std::atomic<int> stop_requests_{0};
  std::atomic<bool> ended_{false};
  std::thread thread_;
  int code_ = -1;
};

}  // namespace metrofarm::test
