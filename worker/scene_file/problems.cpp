#include "scene_file/problems.h"

namespace metrofarm::scene_file {

void Problems::fail(std::string message, const SourceLocation& where) {
  fail(Error{std::move(message), where});
}

void Problems::fail(Error error) {
  if (!error_) error_ = std::move(error);
}

void Problems::unsupported(std::string message, const SourceLocation& where) {
  if (lenient_) {
    warn(std::move(message), where);
  } else {
    fail(std::move(message), where);
  }
}

void Problems::warn(std::string message, const SourceLocation& where) {
  warnings_.push_back(Error{std::move(message), where});
}

}  // namespace metrofarm::scene_file
