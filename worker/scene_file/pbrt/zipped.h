// Files that pbrt reads compressed: NAME.gz.
#pragma once

#include <string>

#include "base/result.h"
#include "scene_file/file_access.h"

namespace metrofarm::scene_file::pbrt {

// The bytes as they are, or decompressed where the name ends in .gz; not more of them than `memory`
// allows a file of that size. Errors have no location.
Result<FileBytes> unzip_if_named_gz(const std::string& name, const FileBytes& bytes,
                                    const MemoryBudget& memory);

}  // namespace metrofarm::scene_file::pbrt
