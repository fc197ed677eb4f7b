#include "rpc/bundle_store.h"

#include <algorithm>
#include <atomic>
#include <fstream>
#include <map>
#include <sstream>
#include <vector>

#include "base/parallel.h"
#include "rpc/sha256.h"

namespace metrofarm::rpc {

namespace fs = std::filesystem;
using Kind = LoadFault::Kind;

namespace {

constexpr size_t kDigestLength = 64;
// How long another process may take to fetch what this one wants, too.
constexpr std::chrono::minutes kPatience(10);

bool is_digest(const std::string& text) {
  return text.size() == kDigestLength &&
         text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

std::string read_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

struct Entry {
  std::string sha256, path;
  uint64_t size = 0;
};

std::vector<Entry> entries_of(const std::string& manifest_lines) {
  std::vector<Entry> entries;
  std::istringstream in(manifest_lines);
  Entry entry;
  while (in >> entry.sha256 >> entry.size && in.get() == ' ' && std::getline(in, entry.path))
    entries.push_back(entry);
  return entries;
}

bool is_whole(const fs::path& file, const Entry& entry) {
  std::error_code failure;
  if (!fs::is_regular_file(file, failure) || fs::file_size(file, failure) != entry.size)
    return false;
  std::ifstream in(file, std::ios::binary);
  Sha256 hash;
  std::string chunk(size_t{256} << 10, '\0');
  while (in) {
    in.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
    hash.update({chunk.data(), static_cast<size_t>(in.gcount())});
  }
  return hash.finish() == entry.sha256;
}

uint64_t bytes_on_disk(const fs::path& path) {
  std::error_code failure;
  if (fs::is_regular_file(path, failure)) {
    const auto size = fs::file_size(path, failure);
    return failure ? 0 : size;
  }
  uint64_t bytes = 0;
  for (fs::recursive_directory_iterator it(path, failure), end; !failure && it != end;
       it.increment(failure)) {
    std::error_code ignored;
    if (it->is_regular_file(ignored)) bytes += it->file_size(ignored);
  }
  return bytes;
}

struct Stored {
  std::string digest;
  uint64_t bytes = 0;
  fs::file_time_type used = fs::file_time_type::min();
};

// What the directory holds, whole or not.
std::vector<Stored> list(const fs::path& directory) {
  std::map<std::string, Stored> found;
  std::error_code failure;
  for (fs::directory_iterator it(directory, failure), end; !failure && it != end;
       it.increment(failure)) {
    const std::string name = it->path().filename();
    const std::string digest = name.substr(0, kDigestLength);
    if (!is_digest(digest) || (name.size() > kDigestLength && name[kDigestLength] != '.')) continue;
    Stored& stored = found[digest];
    stored.digest = digest;
    stored.bytes += bytes_on_disk(it->path());
    std::error_code ignored;
    stored.used = std::max(stored.used, fs::last_write_time(it->path(), ignored));
  }
  std::vector<Stored> all;
  for (auto& [digest, stored] : found) all.push_back(std::move(stored));
  std::sort(all.begin(), all.end(),
            [](const Stored& a, const Stored& b) { return a.used < b.used; });
  return all;
}

uint64_t total(const std::vector<Stored>& all) {
  uint64_t bytes = 0;
  for (const Stored& stored : all) bytes += stored.bytes;
  return bytes;
}

bool write_whole(const fs::path& file, const std::string& content) {
  const fs::path partial = file.string() + ".new";
  std::ofstream out(partial, std::ios::binary | std::ios::trunc);
  out << content;
  out.close();
  std::error_code failure;
  if (!out.fail()) fs::rename(partial, file, failure);
  return !out.fail() && !failure;
}

}  // namespace

BundleStore::BundleStore(fs::path directory, uint64_t max_bytes, Metrics& metrics, Log& log)
    : directory_(std::move(directory)), max_bytes_(max_bytes), metrics_(metrics), log_(log) {
  metrics_.bundle_bytes(bytes());
}

uint64_t BundleStore::bytes() const {
  return total(list(directory_));
}

BundleStore::Found BundleStore::look(const std::string& digest, int threads) const {
  std::error_code failure;
  if (!fs::exists(path(digest), failure)) return Found::kNothing;
  const std::string manifest = read_file(path(digest, ".manifest"));
  if (sha256_hex(manifest) != digest) return manifest.empty() ? Found::kNothing : Found::kDamaged;
  const std::vector<Entry> entries = entries_of(manifest);
  std::atomic<bool> whole = true;
  parallel_for(entries.size(), threads, [&](size_t i, int) {
    if (whole && !is_whole(path(digest) / entries[i].path, entries[i])) whole = false;
  });
  return whole ? Found::kWhole : Found::kDamaged;
}

// Requires: nobody else has the digest's lock, or uses it.
void BundleStore::remove(const std::string& digest) const {
  std::error_code ignored;
  fs::remove(path(digest, ".manifest"), ignored);
  for (fs::directory_iterator it(directory_, ignored), end; !ignored && it != end;
       it.increment(ignored)) {
    const std::string name = it->path().filename();
    std::error_code failure;
    if (name.starts_with(digest) && name != digest + ".lock") fs::remove_all(it->path(), failure);
  }
}

std::string BundleStore::make_room(const std::string& digest, uint64_t bytes) {
  if (bytes > max_bytes_)
    return "the scene's files have " + std::to_string(bytes) + " bytes, more than the " +
           std::to_string(max_bytes_) + " of the worker's --cache-size";
  const std::vector<Stored> all = list(directory_);
  uint64_t held = total(all);
  for (const Stored& oldest : all) {
    if (held <= max_bytes_ - bytes) break;
    if (oldest.digest == digest) continue;
    const auto lock = FileLock::take(path(oldest.digest, ".lock"), FileLock::Kind::kAlone, {});
    if (!lock) continue;  // in use
    remove(oldest.digest);
    std::error_code ignored;
    fs::remove(path(oldest.digest, ".lock"), ignored);
    held -= oldest.bytes;
    if (oldest.bytes > 0) metrics_.bundle_evicted();
    log_.debug("removed a scene bundle to make room", {{"metrofarm.bundle", oldest.digest}});
  }
  return "";
}

std::optional<LoadFault> BundleStore::fetch_alone(const std::string& digest, int threads,
                                                  const Fetch& fetch) {
  const auto lock = FileLock::take(path(digest, ".lock"), FileLock::Kind::kAlone, kPatience);
  if (!lock) return LoadFault{Kind::kWorker, "cannot lock " + path(digest, ".lock").string()};
  const Found found = look(digest, threads);
  if (found == Found::kWhole) return std::nullopt;  // another process was first
  if (found == Found::kDamaged) {
    metrics_.bundle_damaged();
    log_.warn("a scene bundle is damaged on disk; it is fetched again",
              {{"metrofarm.bundle", digest}});
  }
  remove(digest);
  metrics_.bundle_missed();
  std::string problem;
  BundleWriter writer(path(digest), [&](uint64_t bytes) { return make_room(digest, bytes); });
  const CallResult result = fetch(writer, problem);
  if (result == CallResult::kRefused)
    return LoadFault{Kind::kScene, "the scene bundle could not be fetched"};
  if (result != CallResult::kDone) return LoadFault{Kind::kAway};
  // Too small a cache, a disk that is full, bytes that changed on the way: another may be lucky.
  if (!problem.empty()) return LoadFault{Kind::kWorker, problem};
  if (!write_whole(path(digest, ".manifest"), writer.manifest_lines()))
    return LoadFault{Kind::kWorker, "cannot write " + path(digest, ".manifest").string()};
  metrics_.bundle_bytes(bytes());
  return std::nullopt;
}

std::optional<LoadFault> BundleStore::pin(const std::string& digest, int threads,
                                          const Fetch& fetch, Pin& result) {
  if (!is_digest(digest))
    return LoadFault{Kind::kScene, "unsafe bundle digest '" + digest + "': it should be a SHA-256"};
  bool fetched = false;
  // Between fetching and using it another process may remove it, but not many times in a row.
  for (int attempts = 0; attempts < 10; ++attempts) {
    auto lock = FileLock::take(path(digest, ".lock"), FileLock::Kind::kShared, kPatience);
    if (!lock) return LoadFault{Kind::kWorker, "cannot lock " + path(digest, ".lock").string()};
    if (look(digest, threads) == Found::kWhole) {
      if (!fetched) metrics_.bundle_hit();
      lock->touch();
      result = {path(digest), std::move(*lock)};
      return std::nullopt;
    }
    lock.reset();
    if (auto fault = fetch_alone(digest, threads, fetch)) return fault;
    fetched = true;
  }
  return LoadFault{Kind::kWorker, "the scene bundle does not stay on disk: is the cache " +
                                      directory_.string() + " too small?"};
}

}  // namespace metrofarm::rpc
