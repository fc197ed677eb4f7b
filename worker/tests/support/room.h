// A room with a bit of everything: diffuse walls, a glossy sphere, glass, a mirror, lights of two
// sizes and a point light.
#pragma once

#include "tests/support/scenes.h"

namespace metrofarm::test {

inline scene::SceneDescription room() {
  SceneBuilder b;
  const scene::Index white = b.diffuse(0.7F);
  const scene::Index red = b.material(scene::Diffuse{{0.6F, 0.1F, 0.1F}});
  scene::RoughConductor metal;
  metal.distribution = scene::Microfacet::kGgx;
  metal.alpha_u = metal.alpha_v = 0.15F;
  metal.eta = {0.2F, 0.9F, 1.1F};
  metal.k = {3.9F, 2.4F, 2.1F};
  b.shape(box({-2, -1.5, -2}, {2, 1.5, 3}), white, scene::kNone, true);
  b.shape(quad({-1.99, -1.5, 0}, {0, 0, 2}, {0, 2, 0}), b.material(scene::TwoSided{red, red}));
  b.shape(scene::Sphere{{-0.8, -0.9, 1.4}, 0.6}, b.material(metal));
  b.shape(scene::Sphere{{0.8, -0.9, 1.2}, 0.5}, b.material(scene::Dielectric{}));
  b.shape(quad({-0.5, 1.49, 0.5}, {1, 0, 0}, {0, 0, 1}), white, b.area_light(6));
  b.shape(scene::Sphere{{1.4, 0.8, 1}, 0.1}, white, b.area_light(20));
  b.emitter(scene::PointEmitter{{-1.2, 0.5, -1}, {0.8F, 0.7F, 0.6F}});
  b.camera({0, 0, -1.9}, 70);
  return b.take();
}

}  // namespace metrofarm::test
