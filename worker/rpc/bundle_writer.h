// Takes scene bundles in as they arrive.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "metrofarm/scene/v1/scene.pb.h"

namespace metrofarm::rpc {

// Receives a bundle piece by piece and puts it in place when it is whole and every digest is right.
class BundleWriter {
 public:
  // Makes room for a bundle of so many bytes; empty on success, else why there is none.
  using Reserve = std::function<std::string(uint64_t bytes)>;

  // directory: where the bundle ends up; written beside it until then.
  explicit BundleWriter(std::filesystem::path directory, Reserve reserve = {});
  ~BundleWriter();

  // Empty on success, else what is wrong. Order: manifest, then data in manifest order. begin()
  // starts anew where an attempt broke off.
  std::string begin(const metrofarm::scene::v1::BundleManifest& manifest,
                    const std::string& expected_digest);
  std::string append(std::string_view data);
  std::string finish();

  // Of the bundle begun: one line per file, "SHA256 SIZE PATH". Their SHA-256 is its digest.
  const std::string& manifest_lines() const { return manifest_lines_; }

 private:
  std::string open_next();
  std::string close_current();

  struct Impl;
  std::filesystem::path directory_, partial_;
  Reserve reserve_;
  std::string manifest_lines_;
  std::unique_ptr<Impl> impl_;
};

// True for the relative paths that bundles may hold: see BundleFile.path.
bool is_safe_bundle_path(const std::string& path);

}  // namespace metrofarm::rpc
