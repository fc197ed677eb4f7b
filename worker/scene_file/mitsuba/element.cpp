#include "scene_file/mitsuba/element.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

const std::vector<TagInfo>& tag_table() {
  using enum TagKind;
  static const std::vector<TagInfo> kTable = [] {
    std::vector<TagInfo> table = {
        {"ref", kObject, {"id", "name"}},
        {"spectrum", kParameter, {"name", "value", "type", "id", "filename", "intent"}},
        {"rgb", kParameter, {"name", "value", "intent"}},
        {"srgb", kParameter, {"name", "value", "intent"}},
        {"blackbody", kParameter, {"name", "temperature", "scale"}},
        {"transform", kParameter, {"name", "id", "type", "time", "in", "out"}},
        {"animation", kParameter, {"name", "id", "interpolation"}},
        {"point", kParameter, {"name", "value", "x", "y", "z"}},
        {"vector", kParameter, {"name", "value", "x", "y", "z"}},
        {"matrix", kStep, {"value"}},
        {"translate", kStep, {"value", "x", "y", "z"}},
        {"scale", kStep, {"value", "x", "y", "z"}},
        {"rotate", kStep, {"value", "x", "y", "z", "angle"}},
        {"lookat", kStep, {"origin", "target", "up"}},
        {"default", kDirective, {"name", "value"}},
        {"include", kDirective, {"filename"}},
        {"alias", kDirective, {"id", "as"}},
        {"path", kDirective, {"value"}},
        {"null", kDirective, {"name", "id", "type"}},
    };
    for (std::string_view tag :
         {"scene", "integrator", "sensor", "film", "rfilter", "sampler", "bsdf", "texture",
          "emitter", "shape", "medium", "phase", "volume", "subsurface"}) {
      table.push_back({tag, kObject, {"type", "id", "name", "version"}});
    }
    for (std::string_view tag : {"float", "integer", "boolean", "string"}) {
      table.push_back({tag, kParameter, {"name", "value"}});
    }
    return table;
  }();
  return kTable;
}

}  // namespace

const std::string* Element::find(std::string_view attribute) const {
  for (const auto& [name, value] : attributes) {
    if (name == attribute) return &value;
  }
  return nullptr;
}

const std::string& Element::get(std::string_view attribute) const {
  static const std::string kEmpty;
  const std::string* value = find(attribute);
  return value ? *value : kEmpty;
}

std::string Element::describe() const {
  const std::string& type = get("type");
  return type.empty() ? "<" + tag + ">" : tag + " \"" + type + "\"";
}

const TagInfo* find_tag(std::string_view tag) {
  for (const TagInfo& info : tag_table()) {
    if (info.tag == tag) return &info;
  }
  return nullptr;
}

std::vector<std::string_view> known_tags() {
  std::vector<std::string_view> tags;
  for (const TagInfo& info : tag_table()) tags.push_back(info.tag);
  return tags;
}

}  // namespace metrofarm::scene_file::mitsuba
