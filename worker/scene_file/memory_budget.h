// Memory that the files of a scene may take once they are decoded.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include "base/result.h"
#include "scene/description.h"

namespace metrofarm::scene_file {

// Thread-safe. Whether a scene fits doesn't depend on the order in which its parts come.
class MemoryBudget {
 public:
  explicit MemoryBudget(uint64_t bytes) : limit_(bytes) {}

  uint64_t left() const;

  // Bytes that a file of file_bytes may become: decode_limit(), at most what is left.
  uint64_t for_file(uint64_t file_bytes) const;

  // An error if the scene now has more than it may.
  std::optional<Error> take(const scene::TriangleMesh& mesh);
  std::optional<Error> take(const scene::Image& image);
  // A shape or an instance without its mesh. Few lines may stand for any number of them, by
  // references and includes: there may be kMostObjects.
  std::optional<Error> take_object();

  static constexpr uint64_t kMostObjects = uint64_t{1} << 22;

 private:
  std::optional<Error> take(uint64_t bytes);

  const uint64_t limit_;
  std::atomic<uint64_t> objects_ = 0;
  std::atomic<uint64_t> used_ = 0;
};

}  // namespace metrofarm::scene_file
