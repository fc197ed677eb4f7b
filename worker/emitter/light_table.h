// Every emitter of a scene, chosen for who asks (see LightSelection) and sampled eight at a time.
//
// Each primitive of a shape that radiates is a light of its own.
#pragma once

#include "emitter/area_lights.h"
#include "emitter/delta_lights.h"
#include "emitter/environment.h"
#include "emitter/light_sample.h"
#include "emitter/light_selection.h"
#include "geometry/placements.h"
#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "texture/images.h"
#include "texture/textures.h"

namespace metrofarm::emitter {

// How likely bidirectional methods are to find a point on a light, or a direction of the
// environment, that a path from the eye has met.
struct HitDensity {
  Float direct = Float(0.F);    // that sample() chooses it: by area, of directions by solid angle
  Float emission = Float(0.F);  // Emission::pdf of the ray that runs back along the path
};

// Immutable; thread-safe.
class LightTable {
 public:
  // primitives, placements, images, textures: outlive this.
  LightTable(const scene::SceneDescription& description, const geometry::Primitives& primitives,
             const geometry::Placements& placements, const texture::Images& images,
             const texture::Textures& textures);

  // Whether a light without extent moves: those with one are shapes.
  bool anything_moves() const { return deltas_.anything_moves(); }

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

  // ---- paths that start at lights ----

  // Every light by its power alone, for choices that know no receiver.
  const WeightTable& by_power() const { return by_power_; }
  // A ray from a light that is chosen by power: its density includes the choice.
  Emission emit(Float choice, Vec2 position, Vec2 direction, Float time, Mask lanes) const;
  // With which sample() from `receiver`, where the ray ends, would find its beginning: by
  // solid angle times the cosine at the light (of point lights: the squared distance; of parallel
  // light: the probability alone).
  Float direct_density(const Emission& emission, const Receiver& receiver, Mask lanes) const;
  // Emission::pdf of the ray to the receiver over pdf_solid_angle (of delta lights as in
  // direct_density()) and the cosine at the light: both for what sample() has given.
  Float emission_over_direct(const LightSample& sample, Mask lanes) const;
  HitDensity density_of_hit(const Receiver& receiver, const geometry::RayHits& hits,
                            const geometry::Surface& surface, const Vec3& direction,
                            Mask lanes) const;
  HitDensity density_of_environment(const Vec3& direction, Mask lanes) const;
  // Of a sphere around the scene.
  float scene_radius() const { return static_cast<float>(scene_.radius); }

  bool empty() const { return by_power_.empty(); }
  uint64_t bytes() const;

 private:
  // Which kind of light each lane has.
  struct Kinds {
    Mask area, delta, environment;
  };
  void make_distributions();
  Kinds kinds_of(Int light, Mask lanes) const;
  Int delta_index(Int light) const { return light - Int(areas_.count()); }

  BoundingSphere scene_;
  // Lights are numbered: area lights first, then delta lights, then parts of the environment.
  AreaLights areas_;
  DeltaLights deltas_;
  Environment environment_;
  WeightTable by_power_;
  LightSelection selection_;
};

}  // namespace metrofarm::emitter
