// The pbrt-v4 importer. What it reads and where it differs: see worker/doc/scene-format.md.
#pragma once

#include "scene_file/load.h"

namespace metrofarm::scene_file::pbrt {

Result<scene::SceneDescription> import_scene(const std::filesystem::path& file,
                                             const LoadOptions& options);

}  // namespace metrofarm::scene_file::pbrt
