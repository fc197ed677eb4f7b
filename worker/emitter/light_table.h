// Every emitter of a scene, chosen for who asks (see LightSelection) and sampled eight at a time.
//
// Each primitive of a shape that radiates is a light of its own.
#pragma once

#include "emitter/area_lights.h"
#include "emitter/delta_lights.h"
#include "emitter/environment.h"
#include "emitter/light_sample.h"
#include "emitter/light_selection.h"
#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "texture/images.h"
#include "texture/textures.h"

namespace metrofarm::emitter {

// Immutable; thread-safe.
//
// What a sampler of paths that start at lights will need beside sample(): a light without a
// receiver (by_power()), a point of it (AreaLights::uniform_point; a delta light's position; for
// environments and parallel light a point of the disk of the scene's radius across the direction),
// and a direction from it. All but the first is not here yet.
class LightTable {
 public:
  // primitives, images, textures: outlive this.
  LightTable(const scene::SceneDescription& description, const geometry::Primitives& primitives,
             const texture::Images& images, const texture::Textures& textures);

  // A light seen from the receiver. choice picks the light, position a point on it.
  LightSample sample(const Receiver& receiver, Float choice, Vec2 position, Mask lanes) const;

  // Radiance that the surface emits towards where the ray came from, 0 where it is no light.
  // Requires: surface.point is filled if wants_uv().
  Spectrum emitted(const geometry::Surface& surface, const Vec3& direction, Mask lanes) const;
  // pdf_solid_angle with which sample() chooses the direction to the surface hit for the receiver;
  // 0 where the shape is no light.
  Float pdf_of_hit(const Receiver& receiver, const geometry::RayHits& hits,
                   const geometry::Surface& surface, const Vec3& direction, Mask lanes) const;

  // Whether emitted() looks up textures.
  bool wants_uv() const { return areas_.textured(); }

  bool has_environment() const { return !environment_.empty(); }
  // Radiance that arrives against `direction` (unit, away from the scene) where it meets nothing.
  Spectrum environment(const Vec3& direction, Mask lanes) const {
    return environment_.radiance(direction, lanes);
  }
  // pdf_solid_angle with which sample() chooses that direction.
  Float environment_pdf(const Vec3& direction, Mask lanes) const {
    return environment_.pdf_solid_angle(direction, lanes);
  }

  // Every light by its power alone, for choices that know no receiver.
  const WeightTable& by_power() const { return by_power_; }

  bool empty() const { return by_power_.empty(); }
  uint64_t bytes() const;

 private:
  void make_distributions();

  // Lights are numbered: area lights first, then delta lights, then parts of the environment.
  AreaLights areas_;
  DeltaLights deltas_;
  Environment environment_;
  WeightTable by_power_;
  LightSelection selection_;
};

}  // namespace metrofarm::emitter
