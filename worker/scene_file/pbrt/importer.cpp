#include "scene_file/pbrt/importer.h"

#include "scene_file/pbrt/interpreter.h"

namespace metrofarm::scene_file::pbrt {

Result<scene::SceneDescription> import_scene(const std::filesystem::path& file,
                                             const LoadOptions& options) {
  Problems problems(options.lenient);
  FileAccess files(file, options);
  Context context{files, problems};
  Interpreter interpreter(context, options);
  Result<FileBytes> bytes = files.read(file);
  if (!bytes) {
    Error error = bytes.error();
    if (error.where.file.empty()) error.where.file = file.string();
    return error;
  }
  interpreter.run(*bytes.value(), file.string());
  interpreter.finish(file.string());
  if (problems.failed()) return problems.error();
  context.scene.warnings = problems.take_warnings();
  return std::move(context.scene);
}

}  // namespace metrofarm::scene_file::pbrt
