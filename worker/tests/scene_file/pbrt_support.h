// Scenes in pbrt's format for the tests of its importer.
#pragma once

#include <string>
#include <string_view>

#include "scene_file/load.h"
#include "support.h"

namespace metrofarm::scene_file::test {

// `world` after WorldBegin; a shape and a light are added where it has none. The world begins on
// line 2, after `options`, which must be one line.
inline std::string pbrt_around(std::string_view world, std::string_view options = "") {
  std::string text = std::string(options) + " WorldBegin\n" + std::string(world) + "\n";
  if (world.find("LightSource") == std::string_view::npos) text += "LightSource \"infinite\"\n";
  if (world.find("Shape") == std::string_view::npos) text += "Shape \"sphere\"\n";
  return text;
}

inline Result<scene::SceneDescription> load_pbrt(const Directory& directory, std::string_view text,
                                                 const LoadOptions& options = {}) {
  return load_scene(directory.write("scene.pbrt", text), options);
}

// The scene around `world`; the test fails if it doesn't load.
scene::SceneDescription valid_pbrt(std::string_view world, std::string_view options = "",
                                   const LoadOptions& load_options = {});

// "file:line: message" relative to the directory, "" if the text loads.
std::string pbrt_error(std::string_view text, const LoadOptions& options = {});

}  // namespace metrofarm::scene_file::test
