#include "scene_file/mitsuba/defaults.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "scene_file/names.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

// Defaults may be built from defaults, each doubling the text: stop before memory runs out.
constexpr size_t kMaxTextBytes = 1U << 22;

bool is_name_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

}  // namespace

void Defaults::define(const std::string& name, std::string value) {
  unused_.erase(name);
  defined_.insert(name);
  values_.emplace(name, std::move(value));
}

std::string Defaults::substitute(std::string_view text, const SourceLocation& where,
                                 Problems& problems) {
  std::string result;
  while (!text.empty()) {
    const size_t dollar = std::min(text.find('$'), text.size());
    result += text.substr(0, dollar);
    text.remove_prefix(dollar);
    if (text.empty()) break;
    size_t end = 1;
    while (end < text.size() && is_name_character(text[end])) ++end;
    const std::string_view word = text.substr(1, end - 1);
    // In "$scene_left.obj" the parameter may be "scene": take the longest name that is defined.
    std::string_view name = word;
    while (!name.empty() && !values_.contains(name)) name.remove_suffix(1);
    if (name.empty()) {
      std::vector<std::string_view> known(defined_.begin(), defined_.end());
      problems.fail("undefined parameter \"$" + std::string(word) +
                        "\": define it with <default name=\"" + std::string(word) +
                        "\" value=\"...\"/> before its use" + suggestion(word, known),
                    where);
      return result;
    }
    result += values_.find(name)->second;
    if (auto it = unused_.find(name); it != unused_.end()) unused_.erase(it);
    if (result.size() > kMaxTextBytes) {
      problems.fail("the value is longer than 4 MiB after its $parameters are replaced", where);
      return result;
    }
    text.remove_prefix(1 + name.size());
  }
  return result;
}

void Defaults::check_overrides(const std::string& file, Problems& problems) const {
  for (const std::string& name : unused_) {
    std::vector<std::string_view> known(defined_.begin(), defined_.end());
    problems.unsupported("the scene has no parameter \"" + name +
                             "\" that a value could be set for" + suggestion(name, known),
                         {file});
  }
}

}  // namespace metrofarm::scene_file::mitsuba
