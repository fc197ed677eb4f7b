// The worker's life: register, lease, run, deliver, until drained or stopped.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace metrofarm::rpc {

struct WorkerOptions {
  std::string coordinator;  // HOST:PORT
  std::string name;
  std::string isa;
  std::string version;
  int threads = 1;
  std::filesystem::path cache;
};

// Returns when drained, or soon after stop_requested() turns true (what is held is finished and
// delivered first). Returns the exit code.
int run_worker(const WorkerOptions& options, const std::function<bool()>& stop_requested);

}  // namespace metrofarm::rpc
