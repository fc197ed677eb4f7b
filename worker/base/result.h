// Errors from input travel as values: a Result holds either a T or an Error, never both.
#pragma once

#include <string>
#include <utility>
#include <variant>

#include "base/check.h"

namespace metrofarm {

// Where in a user's file something was found. line is 1-based; 0 means that no line is known.
struct SourceLocation {
  std::string file;
  int line = 0;
};

// What is wrong with an input and, in the message itself, what would be right.
struct Error {
  std::string message;
  SourceLocation where = {};

  // "file:line: message", with the parts of the location that are known.
  std::string to_string() const {
    if (where.file.empty()) return message;
    if (where.line <= 0) return where.file + ": " + message;
    return where.file + ":" + std::to_string(where.line) + ": " + message;
  }
};

template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}      // NOLINT(google-explicit-constructor)
  Result(Error error) : state_(std::move(error)) {}  // NOLINT(google-explicit-constructor)

  bool ok() const { return std::holds_alternative<T>(state_); }
  explicit operator bool() const { return ok(); }

  // Requires: ok().
  T& value() {
    METROFARM_CHECK(ok());
    return *std::get_if<T>(&state_);
  }
  const T& value() const {
    METROFARM_CHECK(ok());
    return *std::get_if<T>(&state_);
  }
  // Requires: !ok().
  const Error& error() const {
    METROFARM_CHECK(!ok());
    return *std::get_if<Error>(&state_);
  }

 private:
  std::variant<T, Error> state_;
};

}  // namespace metrofarm
