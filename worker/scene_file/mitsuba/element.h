// The content of a Mitsuba scene file as a tree, after includes, $parameters, aliases and old names
// are dealt with, so that what interprets it sees one version of one document.
#pragma once

#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/result.h"

namespace metrofarm::scene_file::mitsuba {

struct Element {
  std::string tag;
  std::vector<std::pair<std::string, std::string>> attributes;
  std::vector<Element> children;
  SourceLocation where;
  bool legacy = false;  // from a file older than version 2.0.0

  // The attribute's value, or nullptr.
  const std::string* find(std::string_view attribute) const;

  // The attribute's value, or "".
  const std::string& get(std::string_view attribute) const;

  // `bsdf "diffuse"`, or `<transform>` where there is no type: for messages.
  std::string describe() const;
};

struct Document {
  Element root;  // the <scene>
  std::unordered_map<std::string, const Element*> by_id;
};

// What an element stands for: plugins are objects; parameters carry a name and a value; steps are
// the parts of a <transform>; directives are gone once a Document is built.
enum class TagKind { kObject, kParameter, kStep, kDirective };

struct TagInfo {
  std::string_view tag;
  TagKind kind;
  std::vector<std::string_view> attributes;  // those allowed
};

// nullptr for a tag that Mitsuba doesn't know.
const TagInfo* find_tag(std::string_view tag);
std::vector<std::string_view> known_tags();

}  // namespace metrofarm::scene_file::mitsuba
