// Checks of OpenEXR headers before the library reads them.
#pragma once

#include <cstdint>
#include <span>

namespace metrofarm::image_io {

// Whether every attribute of the file's header, or headers, lies inside the file and has the size
// of its type. The library takes memory for as much as they promise, and reads some values without
// regard to their size, after which it takes anything for the next attribute.
bool exr_attributes_fit(std::span<const uint8_t> bytes);

}  // namespace metrofarm::image_io
