// A scene's lights with everything that they refer to.
#pragma once

#include <utility>

#include "emitter/light_table.h"
#include "geometry/primitives.h"
#include "tests/support/scenes.h"
#include "texture/images.h"
#include "texture/textures.h"

namespace metrofarm::test {

struct Lights {
  explicit Lights(scene::SceneDescription description, const motion::Interval& interval = {})
      : scene(std::move(description)),
        primitives(geometry::build_primitives(scene)),
        placements(scene, primitives, interval),
        images(std::move(scene.images)),
        textures(scene.textures, images, primitives),
        table(scene, primitives, placements, images, textures) {}
  explicit Lights(SceneBuilder& builder) : Lights(builder.take()) {}
  Lights(const Lights&) = delete;
  Lights& operator=(const Lights&) = delete;

  // For a receiver that light reaches from both sides.
  emitter::LightSample sample(const Vec3& reference, Float choice, Vec2 u) const {
    return table.sample({reference}, choice, u, all_lanes());
  }

  scene::SceneDescription scene;
  geometry::Primitives primitives;
  geometry::Placements placements;
  texture::Images images;
  texture::Textures textures;
  emitter::LightTable table;
};

// A float image in a colour that depends on the brightness (column, row) -> float only.
template <class Brightness>
scene::Image map_image(int width, int height, Brightness&& brightness) {
  std::vector<float> pixels;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (float channel : {1.F, 0.8F, 0.5F}) pixels.push_back(channel * brightness(x, y));
  return {width, height, 3, std::move(pixels), false};
}

}  // namespace metrofarm::test
