// Bytes as a .serialized file: an error or a mesh that can be finished.
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <utility>

#include "scene_file/serialized.h"

using namespace metrofarm::scene_file;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view file(reinterpret_cast<const char*>(data), size);
  for (int64_t shape_index : {0, 1}) {
    auto mesh = parse_serialized(file, shape_index, 1 << 24);
    if (mesh) static_cast<void>(finish_mesh(std::move(mesh.value()), {}));
  }
  return 0;
}
