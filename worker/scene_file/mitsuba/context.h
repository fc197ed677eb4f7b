// What the loaders of the single plugins share while a scene is built.
#pragma once

#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "scene/description.h"
#include "scene_file/file_access.h"
#include "scene_file/mitsuba/properties.h"

namespace metrofarm::scene_file::mitsuba {

struct Context {
  const Document& document;
  FileAccess& files;
  Problems& problems;
  scene::SceneDescription scene = {};

  // Materials and lights are loaded when first named, and once.
  std::unordered_map<const Element*, scene::Index> bsdfs = {};
  std::unordered_set<const Element*> bsdfs_in_progress = {};
  std::unordered_set<const Element*> attached_emitters = {};
  scene::Index default_bsdf = scene::kNone;
  scene::Index black_bsdf = scene::kNone;

  Properties properties_of(const Element& element) {
    return Properties(element, document, problems);
  }
};

// Reports a plugin that is not known, with the nearest supported name and what happens under
// leniency.
void report_unknown_plugin(const Element& element, const std::vector<std::string_view>& supported,
                           std::string_view instead, Problems& problems);

// A row of a table of plugins of one kind.
template <class Loader>
struct Plugin {
  std::string_view type;
  Loader load;
};

// The row for the element's type, or nullptr after reporting it.
template <class Loader, size_t count>
const Plugin<Loader>* find_plugin(const Plugin<Loader> (&table)[count], const Element& element,
                                  std::string_view instead, Problems& problems) {
  std::vector<std::string_view> supported;
  for (const Plugin<Loader>& plugin : table) {
    if (plugin.type == element.get("type")) return &plugin;
    supported.push_back(plugin.type);
  }
  report_unknown_plugin(element, supported, instead, problems);
  return nullptr;
}

}  // namespace metrofarm::scene_file::mitsuba
