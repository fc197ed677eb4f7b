// The worker's life: register, lease, run, deliver, until drained or stopped.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/log.h"
#include "rpc/addresses.h"
#include "rpc/scene_cache.h"

namespace metrofarm::rpc {

struct WorkerOptions {
  std::vector<HostPort> coordinators;
  std::shared_ptr<grpc::ChannelCredentials> credentials;
  std::string name;
  std::string version;
  int threads = 1;
  SceneCacheOptions scenes;
  std::string metrics;  // HOST:PORT to serve metrics on; empty: nowhere
  double grace_seconds = 20;
  double resolve_seconds = 5;
  Resolve resolve = rpc::resolve;
};

// Returns the exit code: when drained and what is held was delivered, or once stop_requests() is
// over 0. Then what is under way is finished and delivered within grace_seconds, or until
// stop_requests() is over 1, and all other leases are given back. Where the work at hand takes
// longer than that the process ends here.
int run_worker(const WorkerOptions& options, Log& log, const std::function<int()>& stop_requests);

}  // namespace metrofarm::rpc
