// Every emitter of a scene, chosen in proportion to its power and sampled eight at a time.
//
// Area lights are picked by primitive, so where they are not textured all their points are chosen
// with a density proportional to weight_of() what they emit.
#pragma once

#include <vector>

#include "emitter/area_lights.h"
#include "emitter/delta_lights.h"
#include "emitter/environment.h"
#include "emitter/light_sample.h"
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
  // primitives, images, textures: outlive this.
  LightTable(const scene::SceneDescription& description, const geometry::Primitives& primitives,
             const texture::Images& images, const texture::Textures& textures);

  // A light seen from `reference`. choice picks the light, position a point on it.
  LightSample sample(const Vec3& reference, Float choice, Vec2 position, Mask lanes) const;

  // Radiance that the surface emits towards where the ray came from, 0 where it is no light.
  // Requires: surface.point is filled if wants_uv().
  Spectrum emitted(const geometry::Surface& surface, const Vec3& direction, Mask lanes) const;
  // pdf_solid_angle with which sample() from `reference` chooses the direction to the surface hit;
  // 0 where the shape is no light.
  Float pdf_of_hit(const Vec3& reference, const geometry::RayHits& hits,
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

  // A ray from a light that is chosen by power: its density includes the choice.
  Emission emit(Float choice, Vec2 position, Vec2 direction, Mask lanes) const;
  // With which sample() from `reference`, a point that the ray meets, would find its beginning: by
  // solid angle times the cosine at the light (of point lights: the squared distance; of parallel
  // light: the probability alone).
  Float direct_density(const Emission& emission, const Vec3& reference, Mask lanes) const;
  // Emission::pdf of the ray to `reference` over pdf_solid_angle (of delta lights as in
  // direct_density()) and the cosine at the light: both for what sample() has given.
  Float emission_over_direct(const LightSample& sample, Mask lanes) const;
  HitDensity density_of_hit(const Vec3& reference, const geometry::RayHits& hits,
                            const geometry::Surface& surface, const Vec3& direction,
                            Mask lanes) const;
  HitDensity density_of_environment(const Vec3& direction, Mask lanes) const;
  // Of a sphere around the scene.
  float scene_radius() const { return static_cast<float>(scene_.radius); }

  bool empty() const { return cdf_.empty(); }
  uint64_t bytes() const;

 private:
  // Which kind of light each lane has.
  struct Kinds {
    Mask area, delta, environment;
  };
  void make_distribution();
  Kinds kinds_of(Int light, Mask lanes) const;
  Int delta_index(Int light) const { return light - Int(areas_.count()); }

  BoundingSphere scene_;
  // Lights are numbered: area lights first, then delta lights, then parts of the environment.
  AreaLights areas_;
  DeltaLights deltas_;
  Environment environment_;
  std::vector<float> cdf_;   // upper end of each light's part of [0, 1)
  std::vector<float> pick_;  // its length
};

}  // namespace metrofarm::emitter
