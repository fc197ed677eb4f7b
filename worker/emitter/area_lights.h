// Shapes that radiate. Each primitive of such a shape is a light of its own.
#pragma once

#include <vector>

#include "emitter/light_bounds.h"
#include "emitter/light_sample.h"
#include "geometry/placements.h"
#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "texture/textures.h"

namespace metrofarm::emitter {

// Immutable; thread-safe. Lights are numbered from 0, shape by shape.
class AreaLights {
 public:
  // primitives, placements, textures: outlive this.
  AreaLights(const scene::SceneDescription& description, const geometry::Primitives& primitives,
             const geometry::Placements& placements, const texture::Textures& textures);

  int count() const { return static_cast<int>(primitive_.size()); }
  bool textured() const { return textured_; }
  int32_t primitive(int light) const { return primitive_[light]; }
  // Power by weight_of(), W.
  const std::vector<double>& powers() const { return powers_; }
  // Where the light is and where it shines, at any time. Requires: powers() are still there.
  LightBounds bounds(int light) const;
  // Frees powers().
  void forget_powers() { powers_ = {}; }

  // The light at a hit. Requires: the shape radiates in all of `lanes`.
  Int light_at(Int shape, Int primitive, Mask lanes) const;
  Mask radiates(Int shape, Mask lanes) const;

  // A point of `light` as seen from the receiver; pdf_solid_angle is that of the point alone.
  LightSample sample(Int light, const Receiver& receiver, Vec2 u, Mask lanes) const;
  // pdf_solid_angle with which sample() chooses the direction to a hit of `light`.
  Float pdf(Int light, const Receiver& receiver, const geometry::Surface& surface,
            const Vec3& direction, Mask lanes) const;
  // A ray from a uniform point, its direction cosine-weighted around the geometric normal.
  Emission emit(Int light, Vec2 position, Vec2 direction, Float time, Mask lanes) const;
  // Emission::pdf of a ray whose direction makes an angle of that cosine with the normal.
  Float pdf_emission(Int light, Float cosine, Float stretch, Mask lanes) const {
    return pdf_area(light, stretch, lanes) * xsimd::max(cosine * Float(kInvPi), Float(0.F));
  }
  // World area over the area that pdf_area_ is of, at a point with that unit normal in the world: 1
  // but for lights that move or deform, whose points are uniform in their own space.
  Float stretch(Int light, const Vec3& normal, Float time, Mask lanes) const;
  // Radiance against `direction`, 0 on the side that the shading normal turns away from and where
  // nothing radiates.
  Spectrum emitted(const geometry::Surface& surface, const Vec3& direction, Mask lanes) const;

  uint64_t bytes() const;

 private:
  // A point of a light and what emission needs there.
  struct Point {
    Vec3 position;
    Vec3 normal;  // unit, geometric; flipped where the shape says so
    Float offset;
    Float b1 = Float(0.F), b2 = Float(0.F);  // on triangles
    Float stretch = Float(1.F);              // see stretch()
  };
  // How the lights of lanes stand, if they are not in the world's space.
  struct Placed {
    Mask lanes = no_lanes();
    Mask keeps_angles = all_lanes();
    geometry::Carrier carrier;
  };

  void add_shape(const scene::SceneDescription& description, size_t shape);
  const geometry::DeformingMesh* deforming_mesh(size_t shape) const;
  double mean_weight(int light, const scene::Colour& radiance) const;
  LightBounds swept(const LightBounds& own, size_t instance) const;
  Mask of_kind(Int light, geometry::AnalyticKind kind, Mask lanes) const;
  Mask analytic(Int light, Mask lanes) const;
  Vec3 column3(Int light, int first, Mask lanes) const;
  double mean_stretch(int light) const;
  Placed placed(Int light, Float time, Mask lanes) const;
  static void place(const Placed& placed, Point& point);
  static Vec3 local(const Placed& where, const Vec3& point);
  Mask sphere_of(Int light, const Placed& where, Mask lanes) const;
  // Density by area in the world.
  Float pdf_area(Int light, Float stretch, Mask lanes) const {
    const Float pdf = gather(pdf_area_.data(), light, lanes);
    return has_placed_ ? keep(pdf > Float(0.F), pdf / stretch) : pdf;
  }
  Point uniform_point(Int light, Vec2 u, Float time, Mask lanes) const;
  Float own_stretch(Int light, Float time, Mask lanes) const;
  void move_to_disk(Int light, Vec2 u, Mask disk, Point& point) const;
  void move_to_cylinder(Int light, Vec2 u, Mask cylinder, Point& point) const;
  void move_to_sphere(Int light, Vec2 u, Mask sphere, Point& point) const;
  Mask move_to_cap(Int light, const Vec3& reference, Vec2 u, Mask sphere, Point& point,
                   Float& pdf_solid_angle) const;
  Mask outside_sphere(Int light, const Vec3& reference, Mask sphere, Float& one_minus_cos) const;
  geometry::Surface surface_of(Int light, const Point& point, Float time, Mask lanes) const;
  Spectrum radiance(Int shape, const geometry::SurfacePoint& point, Mask lanes) const;
  Float sign_of(Int light, Mask lanes) const;

  const geometry::Primitives& primitives_;
  const geometry::Placements& placements_;
  const texture::Textures& textures_;
  // By light.
  std::vector<int32_t> primitive_;
  std::vector<int32_t> shape_;
  std::vector<int32_t> instance_;  // in whose space it is; kNone: in the world's
  std::vector<int32_t> keeps_angles_;
  std::vector<float> pdf_area_;  // of a uniform point: 1 / area
  std::vector<double> powers_;
  // By shape.
  std::vector<float> radiance_;       // 3 per shape, 0 where it is no light
  std::vector<int32_t> texture_;      // kNone without
  std::vector<int32_t> first_light_;  // the shape's first; kNone where it is no light
  bool textured_ = false;
  bool smooth_ = false;  // some light has vertex normals
  bool has_analytic_ = false;
  bool has_placed_ = false;  // some light is in a space of its own
};

}  // namespace metrofarm::emitter
