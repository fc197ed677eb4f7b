// Scene bundles on disk, found again by content.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "base/log.h"
#include "rpc/bundle_writer.h"
#include "rpc/farm_client.h"
#include "rpc/file_lock.h"
#include "rpc/load_fault.h"
#include "rpc/metrics.h"

namespace metrofarm::rpc {

// A directory that holds, for each bundle DIGEST:
//   DIGEST/           the files
//   DIGEST.manifest   their digests; written last, and itself checked by DIGEST
//   DIGEST.lock       locked for sharing while in use, alone to fetch and to remove; its time is
//   that
//                     of the last use
// Any number of worker processes may share it. Bundles that were used longest ago, and are not in
// use, make room for new ones.
class BundleStore {
 public:
  // problem: empty where all went well, or if the result is not kDone.
  using Fetch = std::function<CallResult(BundleWriter& writer, std::string& problem)>;

  // A bundle that stays while this lives.
  struct Pin {
    std::filesystem::path directory;
    FileLock lock;
  };

  BundleStore(std::filesystem::path directory, uint64_t max_bytes, Metrics& metrics, Log& log);

  // Checks every file of the bundle, on `threads` threads, and fetches it if it is not there or not
  // whole.
  std::optional<LoadFault> pin(const std::string& digest, int threads, const Fetch& fetch,
                               Pin& result);

  uint64_t bytes() const;

 private:
  enum class Found { kNothing, kDamaged, kWhole };
  Found look(const std::string& digest, int threads) const;
  std::optional<LoadFault> fetch_alone(const std::string& digest, int threads, const Fetch& fetch);
  std::string make_room(const std::string& digest, uint64_t bytes);
  void remove(const std::string& digest) const;
  std::filesystem::path path(const std::string& digest, const char* suffix = "") const {
    return directory_ / (digest + suffix);
  }

  std::filesystem::path directory_;
  uint64_t max_bytes_;
  Metrics& metrics_;
  Log& log_;
};

}  // namespace metrofarm::rpc
