#include "app/serve.h"

#include <signal.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "app/serve_options.h"
#include "rpc/sha256.h"
#include "work_unit/version.h"

namespace metrofarm::app {
namespace {

namespace fs = std::filesystem;

std::atomic<int> g_stop_requests{0};

void request_stop(int /*signal*/) {
  ++g_stop_requests;
}

// SIGTERM and SIGINT: finish and leave; a second time: leave at once.
void install_signal_handlers() {
  struct sigaction action{};
  action.sa_handler = request_stop;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
}

// Digest of this very program: two builds may differ in the last bit of anything.
std::string build_digest() {
  std::ifstream self("/proc/self/exe", std::ios::binary);
  rpc::Sha256 hash;
  std::string chunk(1 << 20, '\0');
  while (self) {
    self.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
    hash.update({chunk.data(), static_cast<size_t>(self.gcount())});
  }
  return hash.finish().substr(0, 16);
}

void write_to_stderr(std::string_view line) {
  std::fwrite(line.data(), 1, line.size(), stderr);
}

}  // namespace

int run_serve(const std::vector<std::string>& words) {
  install_signal_handlers();
  auto options = read_serve_options(words);
  if (!options) {
    std::fprintf(stderr, "metrofarm-worker: %s\n", options.error().to_string().c_str());
    return 2;
  }
  rpc::WorkerOptions& worker = options.value().worker;
  worker.version =
      build_digest() + "-" + worker.scenes.isa + "-" + work_unit::probe_hash(worker.scenes.isa);
  Log log("metrofarm-worker", options.value().log_format, write_to_stderr,
          {{"service.version", worker.version}, {"host.name", worker.name}});
  std::error_code failure;
  fs::create_directories(worker.scenes.directory, failure);
  if (failure) {
    log.error("cannot create the cache " + worker.scenes.directory.string() + ": " +
              failure.message());
    return 1;
  }
  return rpc::run_worker(worker, log, [] { return g_stop_requests.load(); });
}

}  // namespace metrofarm::app
