#include "scene_file/memory_budget.h"

#include <algorithm>
#include <string>

#include "base/decode_limit.h"

namespace metrofarm::scene_file {
namespace {

template <class T>
uint64_t bytes_of(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

}  // namespace

uint64_t MemoryBudget::left() const {
  return limit_ - std::min<uint64_t>(limit_, used_);
}

uint64_t MemoryBudget::for_file(uint64_t file_bytes) const {
  return std::min(decode_limit(file_bytes), left());
}

std::optional<Error> MemoryBudget::take(const scene::TriangleMesh& mesh) {
  uint64_t bytes = bytes_of(mesh.positions) + bytes_of(mesh.normals) + bytes_of(mesh.texcoords) +
                   bytes_of(mesh.indices);
  for (const scene::MeshAttribute& attribute : mesh.attributes) bytes += bytes_of(attribute.values);
  return take(bytes);
}

std::optional<Error> MemoryBudget::take(const scene::Image& image) {
  return take(std::visit([](const auto& pixels) { return bytes_of(pixels); }, image.pixels));
}

std::optional<Error> MemoryBudget::take_object() {
  if (++objects_ > kMostObjects) {
    return Error{"the scene has more than " + std::to_string(kMostObjects) +
                 " shapes and instances"};
  }
  return take(sizeof(scene::Shape));
}

std::optional<Error> MemoryBudget::take(uint64_t bytes) {
  const uint64_t used = used_ += bytes;
  if (used <= limit_) return std::nullopt;
  return Error{"with it the shapes and images of the scene take more than the " +
               std::to_string(limit_) + " bytes of memory that are allowed"};
}

}  // namespace metrofarm::scene_file
