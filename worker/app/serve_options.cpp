#include "app/serve_options.h"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <optional>
#include <thread>

#include "app/arguments.h"
#include "base/memory.h"
#include "rpc/security.h"

namespace metrofarm::app {
namespace {

namespace fs = std::filesystem;

std::string host_name() {
  char name[256] = {};
  return gethostname(name, sizeof name - 1) == 0 ? name : "worker";
}

fs::path default_cache() {
  const char* home = std::getenv("XDG_CACHE_HOME");
  if (home != nullptr) return fs::path(home) / "metrofarm";
  return fs::temp_directory_path() / ("metrofarm-cache-" + std::to_string(getuid()));
}

// The bytes that an option gives, or what it is without it.
std::optional<Error> read_bytes(const Arguments& a, const std::string& option, uint64_t& bytes) {
  const std::string text = a.get(option, "");
  if (text.empty()) return std::nullopt;
  const auto parsed = parse_bytes(text);
  if (!parsed) return Error{"--" + option + ": " + parsed.error().message};
  bytes = parsed.value();
  return std::nullopt;
}

std::optional<Error> read_network(const Arguments& a, rpc::WorkerOptions& options) {
  auto coordinators = rpc::parse_coordinators(a.get("coordinator", ""));
  if (!coordinators) return coordinators.error();
  options.coordinators = std::move(coordinators.value());
  const rpc::TlsFiles files{a.get("tls-ca", ""), a.get("tls-cert", ""), a.get("tls-key", "")};
  auto credentials = rpc::make_credentials(files, a.has("insecure"), options.coordinators);
  if (!credentials) return credentials.error();
  options.credentials = std::move(credentials.value());
  options.metrics = a.get("metrics", "");
  return std::nullopt;
}

std::optional<Error> read_limits(const Arguments& a, rpc::WorkerOptions& options) {
  const uint64_t cores = std::max(1U, std::thread::hardware_concurrency());
  const auto threads = a.number("threads", cores, 1, 1024);
  if (!threads) return threads.error();
  const auto grace = a.number("grace", 20, 0, 86400);
  if (!grace) return grace.error();
  options.threads = options.scenes.threads = static_cast<int>(threads.value());
  options.grace_seconds = double(grace.value());
  if (auto error = read_bytes(a, "cache-size", options.scenes.max_bytes)) return error;
  options.scenes.scene_memory = default_scene_memory(available_memory());
  return read_bytes(a, "scene-memory", options.scenes.scene_memory);
}

}  // namespace

uint64_t default_scene_memory(uint64_t available) {
  constexpr uint64_t kUnknown = uint64_t{4} << 30;
  return available == 0 ? kUnknown : available / 2;
}

Result<uint64_t> parse_bytes(const std::string& text) {
  struct Unit {
    const char* name;
    uint64_t bytes;
  };
  static constexpr Unit kUnits[] = {
      {"", 1},
      {"B", 1},
      {"K", 1000},
      {"KB", 1000},
      {"KiB", 1 << 10},
      {"M", 1000000},
      {"MB", 1000000},
      {"MiB", 1 << 20},
      {"G", 1000000000},
      {"GB", 1000000000},
      {"GiB", 1 << 30},
      {"T", 1000000000000},
      {"TB", 1000000000000},
      {"TiB", uint64_t{1} << 40},
  };
  const Error wrong{"'" + text + "' should be a number of bytes such as 1048576, 500MB or 10GiB"};
  uint64_t value = 0;
  const char* last = text.data() + text.size();
  const auto [end, failure] = std::from_chars(text.data(), last, value);
  if (failure != std::errc{}) return wrong;
  const std::string unit(end, last);
  for (const Unit& known : kUnits) {
    if (unit != known.name) continue;
    if (value > std::numeric_limits<uint64_t>::max() / known.bytes) return wrong;
    return value * known.bytes;
  }
  return wrong;
}

Result<ServeOptions> read_serve_options(const std::vector<std::string>& words) {
  const auto parsed = parse_arguments(
      words,
      {"coordinator", "threads", "isa", "name", "cache", "cache-size", "scene-memory", "grace",
       "metrics", "log-format", "tls-ca", "tls-cert", "tls-key"},
      {"insecure"});
  if (!parsed) return parsed.error();
  const Arguments& a = parsed.value();
  if (!a.positional.empty()) return Error{"unexpected argument '" + a.positional[0] + "'"};
  ServeOptions options;
  if (auto error = read_limits(a, options.worker)) return *error;
  if (auto error = read_network(a, options.worker)) return *error;
  options.worker.scenes.isa = a.get("isa", "avx2");
  if (options.worker.scenes.isa != "avx2") return Error{"--isa: only avx2 is supported"};
  options.worker.name = a.get("name", host_name());
  options.worker.scenes.directory = a.get("cache", default_cache().string());
  const std::string format = a.get("log-format", "text");
  if (format != "text" && format != "json")
    return Error{"--log-format: '" + format + "' should be text or json"};
  options.log_format = format == "json" ? LogFormat::kJson : LogFormat::kText;
  return options;
}

}  // namespace metrofarm::app
