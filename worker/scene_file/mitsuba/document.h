// Reads a Mitsuba XML file and what it includes into a Document.
#pragma once

#include <filesystem>

#include "scene_file/file_access.h"
#include "scene_file/load.h"
#include "scene_file/mitsuba/element.h"
#include "scene_file/problems.h"

namespace metrofarm::scene_file::mitsuba {

// Search directories named by <path> are added to `files`. On problems the document is incomplete.
Document read_document(const std::filesystem::path& file, const LoadOptions& options,
                       FileAccess& files, Problems& problems);

}  // namespace metrofarm::scene_file::mitsuba
