// What the loaders of the single plugins share while a scene is built.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "scene/description.h"
#include "scene_file/file_access.h"
#include "scene_file/mesh_queue.h"
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

  // Textures too, each once for lights (where constant spectra mean another colour) and once for
  // the rest; images by file and decoding.
  std::map<std::pair<const Element*, bool>, scene::Colour> textures = {};
  std::unordered_set<const Element*> textures_in_progress = {};
  std::map<std::string, scene::Index> images = {};

  // Mesh files are read at the end. Groups are loaded when first instanced, and once.
  MeshQueue meshes = {};
  std::unordered_map<const Element*, scene::Index> groups = {};
  std::unordered_set<const Element*> shapes_in_progress = {};
  scene::Index null_bsdf = scene::kNone;

  std::unordered_set<const Element*> integrators_in_progress = {};

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
