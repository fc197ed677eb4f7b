// Bytes as a Mitsuba scene file: an error or a scene, strict and lenient. Files that it names are
// searched in an empty directory.
#include <stdlib.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "scene_file/load.h"

namespace {

// Removed when the process ends in order.
struct ScratchDirectory {
  std::filesystem::path path;

  ScratchDirectory() {
    std::string pattern = (std::filesystem::temp_directory_path() / "fuzz_xml_XXXXXX").string();
    if (!mkdtemp(pattern.data())) abort();
    path = pattern;
  }
  ~ScratchDirectory() { std::filesystem::remove_all(path); }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const ScratchDirectory directory;
  const std::filesystem::path file = directory.path / "scene.xml";
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  for (bool lenient : {false, true}) {
    metrofarm::scene_file::LoadOptions options;
    options.lenient = lenient;
    options.root = directory.path;
    options.max_bytes = uint64_t{1} << 24;
    static_cast<void>(metrofarm::scene_file::load_scene(file, options));
  }
  return 0;
}
