// Every emitter of a scene, chosen in proportion to its power and sampled eight at a time.
//
// Area lights are picked by primitive, so all points of all area lights are chosen with a density
// proportional to the luminance they emit; what MIS needs at a hit is then one gather.
#pragma once

#include <vector>

#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "math/warp.h"
#include "spectrum/rgb.h"

namespace metrofarm::emitter {

struct LightSample {
  Vec3 direction = splat(0.F);  // unit, from the reference point towards the light
  Float distance = Float(0.F);  // to the light; infinite for the environment
  Spectrum value = splat(0.F);  // radiance (delta: intensity / d^2) over the pdf of choosing it
  Float pdf_solid_angle = Float(0.F);  // of the whole choice; 0 in delta lanes
  Mask valid = no_lanes();
  Mask delta = no_lanes();
};

class LightTable {
 public:
  LightTable(const scene::SceneDescription& description, const geometry::Primitives& primitives);

  // A light seen from `reference`. choice picks the light, position a point on it.
  LightSample sample(const Vec3& reference, Float choice, Vec2 position, Mask lanes) const;

  // Radiance that the surface emits towards where the ray came from, 0 where it is no light.
  Spectrum emitted(const geometry::Surface& surface, const Vec3& direction, Mask lanes) const;
  // pdf_solid_angle with which sample() from `reference` chooses the direction to the surface hit.
  Float pdf_of_hit(const Vec3& reference, const geometry::RayHits& hits,
                   const geometry::Surface& surface, const Vec3& direction, Mask lanes) const;

  bool has_environment() const { return environment_pick_ > 0; }
  Spectrum environment() const;
  // pdf_solid_angle with which sample() chooses any direction of the environment.
  Float environment_pdf() const { return Float(environment_pick_ / (4 * kPi)); }

  bool empty() const { return cdf_.empty(); }
  uint64_t bytes() const;

 private:
  enum Kind : int32_t { kTriangle, kSphere, kDisk, kPoint, kEnvironment };

  void add(Kind kind, int32_t index, double power);
  void add_area_lights(const scene::SceneDescription& description);
  void add_other_lights(const scene::SceneDescription& description);
  void normalize_picks();
  double scene_radius() const;

  Int pick(Float choice) const;
  LightSample sample_area(Int light, const Vec3& reference, Vec2 u, Mask lanes) const;
  LightSample sample_sphere(Int light, const Vec3& reference, Vec2 u, Mask lanes) const;
  LightSample sample_point(Int light, const Vec3& reference, Mask lanes) const;
  LightSample sample_environment(Vec2 u, Mask lanes) const;
  Mask outside_sphere(Int analytic, const Vec3& reference, Mask lanes, Float& one_minus_cos) const;

  const geometry::Primitives& primitives_;
  // By light, in the order of the cumulative distribution.
  std::vector<float> cdf_;  // upper end of each light's part of [0, 1)
  std::vector<int32_t> kind_;
  std::vector<int32_t> index_;  // primitive, or row in points_
  std::vector<double> power_;   // emptied once the distribution is made
  // By shape.
  std::vector<float> radiance_;       // 3 per shape, 0 where it is no light
  std::vector<float> pick_per_area_;  // pdf_area of choosing any point of the shape
  std::vector<float> pick_;           // probability of choosing the shape (analytic shapes)
  std::vector<float> points_;         // 6 per point light: position, intensity / probability
  float environment_radiance_[3] = {0, 0, 0};
  float environment_pick_ = 0;
};

}  // namespace metrofarm::emitter
