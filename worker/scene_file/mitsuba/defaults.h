// The $parameters of a scene file: <default> elements and the values that replace them.
#pragma once

#include <map>
#include <set>
#include <string>
#include <string_view>

#include "scene_file/problems.h"

namespace metrofarm::scene_file::mitsuba {

class Defaults {
 public:
  explicit Defaults(const std::map<std::string, std::string>& overrides)
      : values_(overrides.begin(), overrides.end()) {
    for (const auto& [name, value] : overrides) unused_.insert(name);
  }

  // The first definition of a name wins, and an override wins over all.
  void define(const std::string& name, std::string value);

  // The text with every $name replaced; an undefined name is a problem.
  std::string substitute(std::string_view text, const SourceLocation& where, Problems& problems);

  // Every override must have been defined or used by the file.
  void check_overrides(const std::string& file, Problems& problems) const;

 private:
  std::map<std::string, std::string, std::less<>> values_;
  std::set<std::string, std::less<>> unused_;
  std::set<std::string, std::less<>> defined_;
};

}  // namespace metrofarm::scene_file::mitsuba
