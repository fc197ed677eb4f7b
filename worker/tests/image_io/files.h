// The files that make_files.py made.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace metrofarm::image_io::test {

inline std::vector<uint8_t> read_file(const std::string& name) {
  std::ifstream in(std::filesystem::path(METROFARM_IMAGE_FILES) / name, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline std::vector<std::string> file_names() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(METROFARM_IMAGE_FILES))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace metrofarm::image_io::test
