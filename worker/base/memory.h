// How much memory this process may use.
#pragma once

#include <cstdint>
#include <filesystem>

namespace metrofarm {

// The smallest of the machine's memory and of the limits of the control groups (version 1 or 2)
// that the process and its ancestors belong to, in bytes; 0 where nothing of that can be read. The
// files are those below `root`: /proc/meminfo, /proc/self/cgroup and /sys/fs/cgroup.
uint64_t available_memory(const std::filesystem::path& root = "/");

}  // namespace metrofarm
