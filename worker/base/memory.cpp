#include "base/memory.h"

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

namespace metrofarm {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kNone = std::numeric_limits<uint64_t>::max();

// The machine's memory; kNone if the file does not tell.
uint64_t machine_memory(const fs::path& root) {
  std::ifstream file(root / "proc/meminfo");
  std::string name;
  uint64_t kibibytes = 0;
  while (file >> name) {
    if (name == "MemTotal:" && file >> kibibytes) return kibibytes * 1024;
    file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
  }
  return kNone;
}

// What a file says that has one number. "max", of version 2, and a file that is not there mean that
// nothing limits; version 1 says the same with a number beyond all memory.
uint64_t read_limit(const fs::path& path) {
  std::ifstream file(path);
  uint64_t bytes = 0;
  return file >> bytes ? bytes : kNone;
}

// The smallest limit of a group and of those above it. A container may see its own group at the top
// although its name says otherwise: folders that are not there limit nothing.
uint64_t smallest_limit(const fs::path& top, fs::path group, const char* name) {
  uint64_t smallest = read_limit(top / name);
  for (; group.has_relative_path(); group = group.parent_path())
    smallest = std::min(smallest, read_limit(top / group.relative_path() / name));
  return smallest;
}

// Whether a list "a,b,c" has the word.
bool lists(const std::string& words, const std::string& word) {
  return ("," + words + ",").find("," + word + ",") != std::string::npos;
}

// Lines of /proc/self/cgroup are HIERARCHY:CONTROLLERS:GROUP; version 2 has hierarchy 0 and names
// no controllers.
uint64_t group_memory(const fs::path& root) {
  const fs::path mounts = root / "sys/fs/cgroup";
  std::ifstream file(root / "proc/self/cgroup");
  uint64_t smallest = kNone;
  std::string line;
  while (std::getline(file, line)) {
    const size_t first = line.find(':');
    const size_t second = first == std::string::npos ? first : line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const fs::path group = line.substr(second + 1);
    if (controllers.empty())
      smallest = std::min(smallest, smallest_limit(mounts, group, "memory.max"));
    else if (lists(controllers, "memory"))
      smallest =
          std::min(smallest, smallest_limit(mounts / "memory", group, "memory.limit_in_bytes"));
  }
  return smallest;
}

}  // namespace

uint64_t available_memory(const fs::path& root) {
  const uint64_t bytes = std::min(machine_memory(root), group_memory(root));
  return bytes == kNone ? 0 : bytes;
}

}  // namespace metrofarm
