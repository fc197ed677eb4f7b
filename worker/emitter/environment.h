// All that shines from infinitely far away on every side: constant radiance and environment maps,
// added up.
#pragma once

#include <vector>

#include "emitter/bounding_sphere.h"
#include "emitter/environment_map.h"
#include "emitter/light_sample.h"
#include "scene/description.h"
#include "texture/images.h"

namespace metrofarm::emitter {

// Thread-safe once picks are set. Its parts are the sum of all constants, if that is not black, and
// each map that is not black.
class Environment {
 public:
  // images: outlives this.
  Environment(const std::vector<scene::Emitter>& emitters, const BoundingSphere& scene,
              const texture::Images& images);

  int count() const { return static_cast<int>(powers_.size()); }
  bool empty() const { return powers_.empty(); }
  // Power by weight_of() that reaches the scene, W.
  const std::vector<double>& powers() const { return powers_; }
  // Probabilities with which callers of sample() and of emit() choose the part.
  void set_picks(int part, double for_sample, double for_emit);

  // direction: unit, away from the scene.
  Spectrum radiance(const Vec3& direction, Mask lanes) const;
  // With which sample(), called with the probabilities that were set, gives the direction.
  Float pdf_solid_angle(const Vec3& direction, Mask lanes) const {
    return mixture(picks_, direction, lanes);
  }

  // A direction that `part` is likely to shine from. Value and pdf are of all parts together: parts
  // overlap, so a sample of one stands for all of them (Veach 1997, section 9.2.4, one-sample
  // estimator with the balance heuristic).
  LightSample sample(Int part, Vec2 u, Mask lanes) const;
  // A ray from there, that starts on the disk across it that covers the scene.
  Emission emit(Int part, Vec2 position, Vec2 direction, Mask lanes) const;
  // Emission::pdf of rays that arrive from `direction` (unit, away from the scene).
  Float pdf_emission(const Vec3& direction, Mask lanes) const {
    return mixture(emission_picks_, direction, lanes) * Float(1.F / scene_.disk_area());
  }

  uint64_t bytes() const;

 private:
  bool has_constant() const { return weight_of_constant_ > 0; }
  Vec3 direction_from(Int part, Vec2 u, Mask lanes) const;
  Float mixture(const std::vector<float>& picks, const Vec3& direction, Mask lanes) const;

  BoundingSphere scene_;
  Spectrum constant_ = splat(0.F);
  double weight_of_constant_ = 0;
  std::vector<EnvironmentMap> maps_;
  std::vector<double> powers_;  // by part: the constant first
  std::vector<float> picks_, emission_picks_;
};

}  // namespace metrofarm::emitter
