// The header of a PLY file: which elements follow, and how their properties are stored.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"

namespace metrofarm::scene_file {

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

size_t byte_size(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;
  std::optional<PlyType> count_type;  // set for lists
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;
  std::vector<PlyProperty> properties;

  // Bytes of one entry if every list is empty: what an honest file holds at least.
  size_t minimum_bytes() const;
};

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  size_t body_offset = 0;  // of the first byte after the header
  int line_count = 0;
};

// Errors name file_name and the line.
Result<PlyHeader> parse_ply_header(std::string_view file, const std::string& file_name);

}  // namespace metrofarm::scene_file
