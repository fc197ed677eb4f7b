// METROFARM_CHECK guards our own invariants (never a user's input): it says what broke and aborts,
// in release builds too.
#pragma once

namespace metrofarm {

[[noreturn]] void check_failed(const char* expression, const char* file, int line);

}  // namespace metrofarm

#define METROFARM_CHECK(expression) \
  ((expression) ? static_cast<void>(0) : ::metrofarm::check_failed(#expression, __FILE__, __LINE__))
