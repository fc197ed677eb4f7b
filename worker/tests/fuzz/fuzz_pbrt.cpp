// pbrt scene files. No other file can be read; those that they name are missing.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "scene_file/pbrt/interpreter.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace metrofarm::scene_file;
  const std::string_view content(reinterpret_cast<const char*>(data), size);
  // A short file may rightly ask for millions of triangles.
  const LoadOptions options{
      .lenient = size % 2 == 0, .root = "/nonexistent", .max_bytes = uint64_t{1} << 19};
  Problems problems(options.lenient);
  FileAccess files("/nonexistent/scene.pbrt", options);
  pbrt::Context context{files, problems};
  pbrt::Interpreter interpreter(context, options);
  interpreter.run(content, "scene.pbrt");
  interpreter.finish("scene.pbrt");
  return 0;
}
