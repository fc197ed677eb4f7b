// Bytes as the content of a mesh file: an error or a mesh that can be finished.
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <utility>

#include "scene_file/ply.h"

using namespace metrofarm::scene_file;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  auto mesh = parse_ply(text, "fuzz.ply", 1 << 24);
  if (mesh) static_cast<void>(finish_mesh(std::move(mesh.value()), {.max_smooth_angle = 30}));
  return 0;
}
