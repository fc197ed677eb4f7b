// What the loaders of the single plugins share while a scene is built.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "scene/description.h"
#include "scene_file/affine.h"
#include "scene_file/file_access.h"
#include "scene_file/pbrt/parameters.h"

namespace metrofarm::scene_file::pbrt {

struct Context {
  FileAccess& files;
  Problems& problems;
  scene::SceneDescription scene = {};

  // What the film makes of a radiance of 1: exposure time times ISO / 100. All lights are scaled by
  // it.
  double imaging_ratio = 1;

  // When the two current transforms hold.
  std::array<double, 2> transform_times = {0, 1};
};

// The motion from the start to the end of TransformTimes; empty where there is none.
scene::Motion motion_between(const std::array<Matrix, 2>& transforms, const SourceLocation& where,
                             Context& context);

// Reports a plugin that is not known: `what` is as the file writes it (Shape "curve"), `instead`
// what happens under leniency.
void report_unknown_plugin(std::string_view what, const Entity& entity,
                           const std::vector<std::string_view>& supported, std::string_view instead,
                           Problems& problems);

// The content of the file that a string parameter names; nullptr after a problem.
FileBytes read_named_file(const std::string& name, const SourceLocation& where, Context& context);

// The same for an image. Integer pixels are sRGB-encoded unless linear is set.
scene::Index read_named_image(const std::string& name, bool linear, const SourceLocation& where,
                              Context& context);

// Index of the new last element.
template <class T>
scene::Index append(std::vector<T>& list, T element) {
  list.push_back(std::move(element));
  return static_cast<scene::Index>(list.size() - 1);
}

}  // namespace metrofarm::scene_file::pbrt
