#include "app/arguments.h"

#include <charconv>

namespace metrofarm::app {

std::string Arguments::get(const std::string& option, const std::string& fallback) const {
  const auto it = options.find(option);
  return it == options.end() ? fallback : it->second.back();
}

Result<uint64_t> Arguments::number(const std::string& option, uint64_t fallback, uint64_t low,
                                   uint64_t high) const {
  const auto it = options.find(option);
  if (it == options.end()) return fallback;
  const std::string& text = it->second.back();
  uint64_t value = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = failure == std::errc{} && end == text.data() + text.size();
  if (!whole || value < low || value > high) {
    return Error{"--" + option + ": '" + text + "' is not a whole number from " +
                 std::to_string(low) + " to " + std::to_string(high)};
  }
  return value;
}

Result<std::map<std::string, std::string>> Arguments::assignments(const std::string& option) const {
  std::map<std::string, std::string> out;
  const auto it = options.find(option);
  if (it == options.end()) return out;
  for (const std::string& text : it->second) {
    const size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
      return Error{"--" + option + ": '" + text + "' should read NAME=VALUE"};
    out[text.substr(0, equals)] = text.substr(equals + 1);
  }
  return out;
}

Result<Arguments> parse_arguments(const std::vector<std::string>& words,
                                  const std::set<std::string>& options,
                                  const std::set<std::string>& flags) {
  Arguments out;
  for (size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (!word.starts_with("--")) {
      out.positional.push_back(word);
      continue;
    }
    const size_t equals = word.find('=');
    const std::string name = word.substr(2, equals == std::string::npos ? equals : equals - 2);
    if (flags.contains(name) && equals == std::string::npos) {
      out.flags.insert(name);
    } else if (!options.contains(name)) {
      return Error{"unknown option --" + name};
    } else if (equals != std::string::npos) {
      out.options[name].push_back(word.substr(equals + 1));
    } else if (i + 1 < words.size()) {
      out.options[name].push_back(words[++i]);
    } else {
      return Error{"--" + name + " needs a value"};
    }
  }
  return out;
}

}  // namespace metrofarm::app
