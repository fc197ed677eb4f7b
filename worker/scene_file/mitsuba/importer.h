// Scenes in the XML format of Mitsuba: versions 3 and 2, and 0.x where only names differ.
#pragma once

#include <filesystem>

#include "base/result.h"
#include "scene/description.h"
#include "scene_file/load.h"

namespace metrofarm::scene_file::mitsuba {

Result<scene::SceneDescription> import_scene(const std::filesystem::path& file,
                                             const LoadOptions& options);

}  // namespace metrofarm::scene_file::mitsuba
