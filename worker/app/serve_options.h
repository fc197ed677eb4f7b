// What `metrofarm-worker --coordinator ...` can be told.
#pragma once

#include <string>
#include <vector>

#include "base/log.h"
#include "base/result.h"
#include "rpc/worker.h"

namespace metrofarm::app {

struct ServeOptions {
  rpc::WorkerOptions worker;  // all but the version
  LogFormat log_format = LogFormat::kText;
};

Result<ServeOptions> read_serve_options(const std::vector<std::string>& words);

// "10GiB", "500MB", "1048576": a whole number with or without a unit, powers of 1000 (K or KB, M,
// G, T) or of 1024 (KiB, MiB, GiB, TiB).
Result<uint64_t> parse_bytes(const std::string& text);

}  // namespace metrofarm::app
