// Camera, film, filter, sampler and integrator.
#pragma once

#include <array>
#include <optional>

#include "scene_file/pbrt/context.h"

namespace metrofarm::scene_file::pbrt {

// What stands before WorldBegin; pbrt's default where a directive is missing.
struct RenderingOptions {
  Entity camera = {"perspective", {}};
  Entity film = {"rgb", {}};
  Entity filter = {"gaussian", {}};
  Entity sampler = {"zsobol", {}};
  Entity integrator = {"volpath", {}};
  std::array<Matrix, 2> world_from_camera = {kIdentity, kIdentity};  // as the current transforms
};

// Fills sensor, film and integrator of the scene, and the imaging ratio.
void load_options(RenderingOptions& options, Context& context);

}  // namespace metrofarm::scene_file::pbrt
