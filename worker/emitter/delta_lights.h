// Lights without extent: point, spot and projector at a position, parallel light from a direction.
// Each reaches a point along one line only, so chance never meets them.
#pragma once

#include <vector>

#include "emitter/bounding_sphere.h"
#include "emitter/light_bounds.h"
#include "emitter/light_sample.h"
#include "motion/pose_table.h"
#include "scene/description.h"
#include "texture/textures.h"

namespace metrofarm::emitter {

// Immutable; thread-safe. Lights are numbered from 0 in the order of the description, lights of
// intensity zero left out.
class DeltaLights {
 public:
  // textures: outlives this. scene: everything that can be lit. interval: that of lanes' times.
  DeltaLights(const std::vector<scene::Emitter>& emitters, const BoundingSphere& scene,
              const motion::Interval& interval, const texture::Textures& textures);

  int count() const { return static_cast<int>(kind_.size()); }
  // Power by weight_of(), W; of parallel light what falls onto the scene.
  const std::vector<double>& powers() const { return powers_; }
  bool infinitely_far(int light) const { return kind_[light] == kDirectional; }
  // Where the light is and where it shines, at any time. Requires: not infinitely far away;
  // powers() are still there.
  LightBounds bounds(int light) const;
  // Frees powers().
  void forget_powers() { powers_ = {}; }

  bool anything_moves() const { return poses_.count() > 0; }

  LightSample sample(Int light, const Receiver& receiver, Mask lanes) const;

  // A ray that leaves `light`: one pair chooses where parallel light starts on the disk across it
  // that covers the scene, the other the direction from all other lights.
  Emission emit(Int light, Vec2 position, Vec2 direction, Float time, Mask lanes) const;
  // Emission::pdf of a ray with that direction (unit, away from the light).
  Float pdf_emission(Int light, const Vec3& direction, Float time, Mask lanes) const;
  // Lanes whose light is parallel.
  Mask parallel(Int light, Mask lanes) const;

  uint64_t bytes() const;

 private:
  enum Kind : int32_t { kPoint, kSpot, kProjector, kDirectional };

  // Where lights are and how they are turned. The rows of to_light span a volume of 1 or -1.
  struct Place {
    Vec3 position;  // of parallel light the unit direction towards the light
    Vec3 to_light[3];

    Vec3 to_local(const Vec3& v) const {
      return {dot(to_light[0], v), dot(to_light[1], v), dot(to_light[2], v)};
    }
    Vec3 to_world(const Vec3& local) const;
  };

  void add(const scene::Emitter& emitter);
  void add(const scene::PointEmitter& point);
  void add(const scene::SpotEmitter& spot);
  void add(const scene::ProjectorEmitter& projector);
  void add(const scene::DirectionalEmitter& directional);
  float* new_row(Kind kind, const scene::Colour& intensity, double power);
  double mean_weight(const scene::Colour& colour) const;
  Vec3 column3(Int light, int first, Mask lanes) const;
  void set_in_motion(const scene::Emitter& emitter);
  Place place_of(Int light, Float time, Mask lanes) const;
  Mask of_kind(Int light, Kind kind, Mask lanes) const;
  Spectrum intensity(Int light, const Place& place, const Vec3& direction, Mask lanes) const;
  Vec3 sample_direction(Int light, const Place& place, Vec2 u, Mask lanes) const;
  Float pdf_emission(Int light, const Place& place, const Vec3& direction, Mask lanes) const;
  Spectrum spot_intensity(Int light, const Vec3& local, Mask lanes) const;
  Spectrum projector_irradiance(Int light, const Vec3& local, Mask lanes) const;
  Spectrum textured(Int light, const Spectrum& value, Vec2 uv, Mask lanes) const;

  const texture::Textures& textures_;
  BoundingSphere scene_;
  std::vector<int32_t> kind_;
  std::vector<int32_t> texture_;  // kNone without
  std::vector<float> rows_;       // kStride per light
  std::vector<double> powers_;
  bool shaped_ = false;  // some light is more than a point
  motion::PoseTable poses_;
  std::vector<int32_t> moving_;  // by light: its number in poses_, -1 where it does not move
};

}  // namespace metrofarm::emitter
