// Command-line arguments: options that take a value, flags, and positional words, in any order.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/result.h"

namespace metrofarm::app {

struct Arguments {
  std::vector<std::string> positional;
  std::map<std::string, std::vector<std::string>> options;  // without the dashes
  std::set<std::string> flags;

  bool has(const std::string& flag) const { return flags.contains(flag); }
  // The last value given, or fallback.
  std::string get(const std::string& option, const std::string& fallback) const;
  // A whole number in [low, high], or fallback where the option is absent.
  Result<uint64_t> number(const std::string& option, uint64_t fallback, uint64_t low,
                          uint64_t high) const;
  // All "NAME=VALUE" values of a repeatable option.
  Result<std::map<std::string, std::string>> assignments(const std::string& option) const;
};

// Accepts "--name value" and "--name=value"; fails on names in neither set.
Result<Arguments> parse_arguments(const std::vector<std::string>& words,
                                  const std::set<std::string>& options,
                                  const std::set<std::string>& flags);

}  // namespace metrofarm::app
