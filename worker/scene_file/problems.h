// Collects what is wrong with a file while it is read. The first error is kept and ends the load;
// whoever walks the file goes on with a harmless value until the next place that asks failed().
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"

namespace metrofarm::scene_file {

class Problems {
 public:
  explicit Problems(bool lenient) : lenient_(lenient) {}

  void fail(std::string message, const SourceLocation& where);
  void fail(Error error);

  // Something that the file asks for and that is not known here: an error, or only a warning where
  // the user asked for leniency.
  void unsupported(std::string message, const SourceLocation& where);

  void warn(std::string message, const SourceLocation& where);

  bool lenient() const { return lenient_; }
  bool failed() const { return error_.has_value(); }
  // Requires: failed().
  const Error& error() const { return *error_; }
  std::vector<Error> take_warnings() { return std::move(warnings_); }

 private:
  bool lenient_;
  std::optional<Error> error_;
  std::vector<Error> warnings_;
};

}  // namespace metrofarm::scene_file
