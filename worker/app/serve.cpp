#include "app/serve.h"

#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <thread>

#include "app/arguments.h"
#include "rpc/sha256.h"
#include "rpc/worker.h"
#include "work_unit/version.h"

namespace metrofarm::app {
namespace {

namespace fs = std::filesystem;

std::atomic<bool> g_stop{false};

void request_stop(int /*signal*/) {
  g_stop = true;
}

// Finish and leave on SIGTERM and SIGINT.
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

std::string host_name() {
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 ? name : "worker";
}

fs::path default_cache() {
  const char* home = std::getenv("XDG_CACHE_HOME");
  if (home != nullptr) return fs::path(home) / "metrofarm";
  return fs::temp_directory_path() / ("metrofarm-cache-" + std::to_string(getuid()));
}

Result<rpc::WorkerOptions> read_options(const std::vector<std::string>& words) {
  const auto parsed =
      parse_arguments(words, {"coordinator", "threads", "isa", "name", "cache"}, {});
  if (!parsed) return parsed.error();
  const Arguments& a = parsed.value();
  if (!a.positional.empty()) return Error{"unexpected argument '" + a.positional[0] + "'"};
  const uint64_t cores = std::max(1U, std::thread::hardware_concurrency());
  const auto threads = a.number("threads", cores, 1, 1024);
  if (!threads) return threads.error();
  rpc::WorkerOptions options;
  options.coordinator = a.get("coordinator", "");
  if (options.coordinator.empty()) return Error{"--coordinator HOST:PORT is required"};
  options.isa = a.get("isa", "avx2");
  if (options.isa != "avx2") return Error{"--isa: only avx2 is supported"};
  options.threads = static_cast<int>(threads.value());
  options.name = a.get("name", host_name());
  options.cache = a.get("cache", default_cache().string());
  options.version = build_digest() + "-" + options.isa + "-" + work_unit::probe_hash(options.isa);
  return options;
}

}  // namespace

int run_serve(const std::vector<std::string>& words) {
  const auto options = read_options(words);
  if (!options) {
    std::fprintf(stderr, "metrofarm-worker: %s\n", options.error().to_string().c_str());
    return 2;
  }
  std::error_code failure;
  fs::create_directories(options.value().cache, failure);
  if (failure) {
    std::fprintf(stderr, "metrofarm-worker: cannot create the cache %s: %s\n",
                 options.value().cache.c_str(), failure.message().c_str());
    return 1;
  }
  install_signal_handlers();
  return rpc::run_worker(options.value(), [] { return g_stop.load(); });
}

}  // namespace metrofarm::app
