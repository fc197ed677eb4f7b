#include "scene_file/load.h"

#include <array>
#include <optional>
#include <variant>

#include "scene_file/importer.h"
#include "scene_file/limits.h"
#include "scene_file/mitsuba/importer.h"
#include "scene_file/names.h"
#include "scene_file/pbrt/importer.h"

namespace metrofarm::scene_file {
namespace {

constexpr std::array kImporters = {
    Importer{".xml", "Mitsuba XML", &mitsuba::import_scene},
    Importer{".pbrt", "pbrt-v4", &pbrt::import_scene},
};

std::string supported_formats() {
  std::string list;
  for (const Importer& importer : importers()) {
    if (!list.empty()) list += ", ";
    list += std::string(importer.extension) + " (" + std::string(importer.format) + ")";
  }
  return list;
}

bool lights_the_scene(const scene::SceneDescription& scene) {
  for (const scene::Shape& shape : scene.shapes) {
    if (shape.area_emitter != scene::kNone) return true;
  }
  for (const scene::Emitter& emitter : scene.emitters) {
    if (!std::holds_alternative<scene::AreaEmitter>(emitter.model)) return true;
  }
  return false;
}

}  // namespace

std::span<const Importer> importers() {
  return kImporters;
}

Result<scene::SceneDescription> load_scene(const std::filesystem::path& file,
                                           const LoadOptions& options) {
  const std::string extension = lower_case(file.extension().string());
  for (const Importer& importer : importers()) {
    if (importer.extension != extension) continue;
    Result<scene::SceneDescription> scene = importer.load(file, options);
    if (!scene) return scene;
    if (scene.value().shapes.empty()) {
      return Error{"the scene has no shapes: it needs at least one <shape>", {file.string()}};
    }
    if (!lights_the_scene(scene.value())) {
      return Error{
          "the scene has no emitter: add an area light to a shape, a point light or a "
          "constant environment, or the image is black",
          {file.string()}};
    }
    if (std::optional<Error> error = check_limits(scene.value())) return *error;
    return scene;
  }
  return Error{
      "no importer for files ending in \"" + extension + "\"; supported: " + supported_formats(),
      {file.string()}};
}

}  // namespace metrofarm::scene_file
