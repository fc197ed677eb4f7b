// What `metrofarm-worker --coordinator ...` can be told.
#pragma once

#include <cstdint>
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

// What scenes may take of the memory that the process may use: half, as films, the textures'
// decoders and the ray tracer's building need the rest; 4 GiB where it is not known (0).
uint64_t default_scene_memory(uint64_t available);

// "10GiB", "500MB", "1048576": a whole number with or without a unit, powers of 1000 (K or KB, M,
// G, T) or of 1024 (KiB, MiB, GiB, TiB).
Result<uint64_t> parse_bytes(const std::string& text);

}  // namespace metrofarm::app
