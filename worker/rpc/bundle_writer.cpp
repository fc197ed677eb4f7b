#include "rpc/bundle_writer.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "rpc/sha256.h"

namespace metrofarm::rpc {

namespace fs = std::filesystem;
using metrofarm::scene::v1::BundleFile;
using metrofarm::scene::v1::BundleManifest;

namespace {

// One line per file. Its SHA-256 is the bundle's digest.
std::string lines_of(const BundleManifest& manifest) {
  std::string lines;
  for (const BundleFile& file : manifest.files())
    lines += file.sha256() + " " + std::to_string(file.size()) + " " + file.path() + "\n";
  return lines;
}

}  // namespace

bool is_safe_bundle_path(const std::string& path) {
  if (path.empty() || path.size() > 1024 || path.front() == '/') return false;
  if (path.find('\\') != std::string::npos || path.find('\0') != std::string::npos) return false;
  size_t start = 0;
  while (start <= path.size()) {
    const size_t end = std::min(path.find('/', start), path.size());
    const std::string part = path.substr(start, end - start);
    if (part.empty() || part == "." || part == "..") return false;
    start = end + 1;
  }
  return true;
}

struct BundleWriter::Impl {
  BundleManifest manifest;
  int next = 0;  // file to open next
  std::ofstream out;
  std::unique_ptr<Sha256> hash;
  uint64_t left = 0;  // bytes missing from the open file
};

BundleWriter::BundleWriter(fs::path directory, Reserve reserve)
    : directory_(std::move(directory)),
      reserve_(std::move(reserve)),
      partial_(directory_.string() + ".part-" + std::to_string(getpid())),
      impl_(std::make_unique<Impl>()) {}

BundleWriter::~BundleWriter() {
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
}

std::string BundleWriter::begin(const BundleManifest& manifest,
                                const std::string& expected_digest) {
  for (const BundleFile& file : manifest.files()) {
    if (!is_safe_bundle_path(file.path())) return "unsafe path in bundle: '" + file.path() + "'";
  }
  manifest_lines_ = lines_of(manifest);
  if (sha256_hex(manifest_lines_) != expected_digest)
    return "the bundle's manifest has another digest";
  uint64_t bytes = 0;
  for (const BundleFile& file : manifest.files()) bytes += file.size();
  if (reserve_) {
    if (std::string problem = reserve_(bytes); !problem.empty()) return problem;
  }
  impl_ = std::make_unique<Impl>();  // an attempt that broke off is forgotten
  impl_->manifest = manifest;
  std::error_code failure;
  fs::remove_all(partial_, failure);
  fs::create_directories(partial_, failure);
  return failure ? "cannot create " + partial_.string() + ": " + failure.message() : "";
}

std::string BundleWriter::open_next() {
  const BundleFile& file = impl_->manifest.files(impl_->next++);
  const fs::path path = partial_ / file.path();
  std::error_code failure;
  fs::create_directories(path.parent_path(), failure);
  impl_->out.open(path, std::ios::binary | std::ios::trunc);
  if (!impl_->out) return "cannot write " + path.string();
  impl_->hash = std::make_unique<Sha256>();
  impl_->left = file.size();
  return impl_->left == 0 ? close_current() : "";
}

std::string BundleWriter::close_current() {
  const BundleFile& file = impl_->manifest.files(impl_->next - 1);
  impl_->out.close();
  if (impl_->out.fail()) return "cannot write " + file.path();
  const bool right = impl_->hash->finish() == file.sha256();
  impl_->hash.reset();
  return right ? "" : "'" + file.path() + "' arrived with another digest than its manifest's";
}

std::string BundleWriter::append(std::string_view data) {
  while (!data.empty()) {
    if (impl_->hash == nullptr) {
      if (impl_->next == impl_->manifest.files_size()) return "more data than the manifest names";
      if (std::string problem = open_next(); !problem.empty()) return problem;
      continue;
    }
    const auto take = static_cast<size_t>(std::min<uint64_t>(impl_->left, data.size()));
    impl_->out.write(data.data(), static_cast<std::streamsize>(take));
    impl_->hash->update(data.substr(0, take));
    impl_->left -= take;
    data.remove_prefix(take);
    if (impl_->left > 0) continue;
    if (std::string problem = close_current(); !problem.empty()) return problem;
  }
  return "";
}

std::string BundleWriter::finish() {
  while (impl_->hash == nullptr && impl_->next < impl_->manifest.files_size()) {
    if (std::string problem = open_next(); !problem.empty()) return problem;
  }
  if (impl_->hash != nullptr) return "the bundle ended early";
  std::error_code failure;
  fs::rename(partial_, directory_, failure);
  // Another worker on this machine may have been first.
  if (failure && !fs::exists(directory_))
    return "cannot create " + directory_.string() + ": " + failure.message();
  return "";
}

}  // namespace metrofarm::rpc
