// The seam between load_scene and the formats it reads. A new format is one more row in
// importers(); nothing else knows the list.
#pragma once

#include <filesystem>
#include <span>
#include <string_view>

#include "base/result.h"
#include "scene/description.h"
#include "scene_file/load.h"

namespace metrofarm::scene_file {

struct Importer {
  std::string_view extension;  // lower case, with the dot
  std::string_view format;     // for messages
  Result<scene::SceneDescription> (*load)(const std::filesystem::path& file,
                                          const LoadOptions& options);
};

std::span<const Importer> importers();

}  // namespace metrofarm::scene_file
