// Lights without extent: point, spot and projector at a position, parallel light from a direction.
// Each reaches a point along one line only, so chance never meets them.
#pragma once

#include <vector>

#include "emitter/bounding_sphere.h"
#include "emitter/light_bounds.h"
#include "emitter/light_sample.h"
#include "scene/description.h"
#include "texture/textures.h"

namespace metrofarm::emitter {

// Immutable; thread-safe. Lights are numbered from 0 in the order of the description, lights of
// intensity zero left out.
//
class DeltaLights {
 public:
  // textures: outlives this. scene: everything that can be lit.
  DeltaLights(const std::vector<scene::Emitter>& emitters, const BoundingSphere& scene,
              const texture::Textures& textures);

  int count() const { return static_cast<int>(kind_.size()); }
  // Power by weight_of(), W; of parallel light what falls onto the scene.
  const std::vector<double>& powers() const { return powers_; }
  bool infinitely_far(int light) const { return kind_[light] == kDirectional; }
  // Where the light is and where it shines. Requires: not infinitely far away; powers() are still
  // there.
  LightBounds bounds(int light) const;
  // Frees powers().
  void forget_powers() { powers_ = {}; }

  LightSample sample(Int light, const Vec3& reference, Mask lanes) const;

  // A ray that leaves `light`: one pair chooses where parallel light starts on the disk across it
  // that covers the scene, the other the direction from all other lights.
  Emission emit(Int light, Vec2 position, Vec2 direction, Mask lanes) const;
  // Emission::pdf of a ray with that direction (unit, away from the light).
  Float pdf_emission(Int light, const Vec3& direction, Mask lanes) const;
  // Lanes whose light is parallel.
  Mask parallel(Int light, Mask lanes) const;

  uint64_t bytes() const;

 private:
  enum Kind : int32_t { kPoint, kSpot, kProjector, kDirectional };

  void add(const scene::PointEmitter& point);
  void add(const scene::SpotEmitter& spot);
  void add(const scene::ProjectorEmitter& projector);
  void add(const scene::DirectionalEmitter& directional);
  float* new_row(Kind kind, const scene::Colour& intensity, double power);
  double mean_weight(const scene::Colour& colour) const;
  Vec3 column3(Int light, int first, Mask lanes) const;
  Vec3 to_local(Int light, const Vec3& v, Mask lanes) const;
  Mask of_kind(Int light, Kind kind, Mask lanes) const;
  Spectrum intensity(Int light, const Vec3& direction, Mask lanes) const;
  Vec3 sample_direction(Int light, Vec2 u, Mask lanes) const;
  Vec3 to_world(Int light, const Vec3& local, Mask lanes) const;
  Spectrum spot_intensity(Int light, const Vec3& direction, Mask lanes) const;
  Spectrum projector_irradiance(Int light, const Vec3& local, Mask lanes) const;
  Spectrum textured(Int light, const Spectrum& value, Vec2 uv, Mask lanes) const;

  const texture::Textures& textures_;
  BoundingSphere scene_;
  std::vector<int32_t> kind_;
  std::vector<int32_t> texture_;  // kNone without
  std::vector<float> rows_;       // kStride per light
  std::vector<double> powers_;
  bool shaped_ = false;  // some light is more than a point
};

}  // namespace metrofarm::emitter
