#include "scene_file/ply_attributes.h"

#include <algorithm>
#include <array>
#include <optional>

namespace metrofarm::scene_file {
namespace {

std::optional<size_t> find_scalar(const PlyElement& element, std::string_view name) {
  for (size_t i = 0; i < element.properties.size(); ++i) {
    const PlyProperty& property = element.properties[i];
    if (property.name == name && !property.count_type) return i;
  }
  return std::nullopt;
}

float colour_scale(PlyType type) {
  switch (type) {
    case PlyType::kUint8:
      return 1.0F / 255;
    case PlyType::kUint16:
      return 1.0F / 65535;
    default:
      return 1;
  }
}

bool add_colour(const PlyElement& element, std::string_view prefix,
                const std::array<std::string_view, 3>& names,
                std::vector<PlyAttribute>& attributes) {
  PlyAttribute colour{std::string(prefix) + "color", {}, 1};
  for (std::string_view name : names) {
    const std::optional<size_t> property = find_scalar(element, name);
    if (!property) return false;
    colour.properties.push_back(*property);
  }
  colour.scale = colour_scale(element.properties[colour.properties[0]].type);
  attributes.push_back(std::move(colour));
  return true;
}

}  // namespace

std::vector<PlyAttribute> find_attributes(const PlyElement& element, std::string_view prefix) {
  std::vector<PlyAttribute> attributes;
  if (!add_colour(element, prefix, {"r", "g", "b"}, attributes)) {
    add_colour(element, prefix, {"red", "green", "blue"}, attributes);
  }
  constexpr size_t kMaxAttributes = 64;
  for (size_t i = 0; i < element.properties.size(); ++i) {
    const PlyProperty& property = element.properties[i];
    const size_t length = property.name.size();
    // One letter after the last underscore tells the channels apart.
    if (property.count_type || length < 3 || property.name[length - 2] != '_') continue;
    const std::string name = std::string(prefix) + property.name.substr(0, length - 2);
    const auto same = std::find_if(attributes.begin(), attributes.end(),
                                   [&](const PlyAttribute& known) { return known.name == name; });
    if (same != attributes.end()) {
      same->properties.push_back(i);
    } else if (attributes.size() < kMaxAttributes) {
      attributes.push_back({name, {i}, 1});
    }
  }
  std::erase_if(attributes, [](const PlyAttribute& attribute) {
    return attribute.properties.size() != 1 && attribute.properties.size() != 3;
  });
  return attributes;
}

}  // namespace metrofarm::scene_file
