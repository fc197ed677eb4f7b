// Turns exceptions into messages at the C border.
#ifndef METROFARM_EXR_SHIM_ERROR_H
#define METROFARM_EXR_SHIM_ERROR_H

#include <cstdlib>
#include <cstring>
#include <exception>

namespace metrofarm {

inline char* copy_message(const char* text) {
  const size_t size = std::strlen(text) + 1;
  auto* copy = static_cast<char*>(std::malloc(size));
  if (copy == nullptr) std::abort();
  return static_cast<char*>(std::memcpy(copy, text, size));
}

// Runs body; returns NULL, or the message of what it threw.
template <typename Body>
char* guarded(Body&& body) noexcept {
  try {
    body();
    return nullptr;
  } catch (const std::exception& error) {
    return copy_message(error.what());
  } catch (...) {
    return copy_message("OpenEXR threw something that is no std::exception");
  }
}

}  // namespace metrofarm

#endif
