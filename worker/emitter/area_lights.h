// Shapes that radiate. Each primitive of such a shape is a light of its own.
#pragma once

#include <vector>

#include "emitter/light_bounds.h"
#include "emitter/light_sample.h"
#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "texture/textures.h"

namespace metrofarm::emitter {

// Immutable; thread-safe. Lights are numbered from 0, shape by shape.
class AreaLights {
 public:
  // primitives, textures: outlive this.
  AreaLights(const scene::SceneDescription& description, const geometry::Primitives& primitives,
             const texture::Textures& textures);

  int count() const { return static_cast<int>(primitive_.size()); }
  bool textured() const { return textured_; }
  int32_t primitive(int light) const { return primitive_[light]; }
  // Power by weight_of(), W.
  const std::vector<double>& powers() const { return powers_; }
  // Where the light is and where it shines. Requires: powers() are still there.
  LightBounds bounds(int light) const;
  // Frees powers().
  void forget_powers() { powers_ = {}; }

  // The light at a hit. Requires: the shape radiates in all of `lanes`.
  Int light_at(Int shape, Int primitive, Mask lanes) const;
  Mask radiates(Int shape, Mask lanes) const;

  // A point of `light` as seen from `reference`; pdf_solid_angle is that of the point alone.
  LightSample sample(Int light, const Vec3& reference, Vec2 u, Mask lanes) const;
  // pdf_solid_angle with which sample() chooses the direction to a hit of `light`.
  Float pdf(Int light, const Vec3& reference, const geometry::Surface& surface,
            const Vec3& direction, Mask lanes) const;
  // A ray from a uniform point, its direction cosine-weighted around the geometric normal.
  Emission emit(Int light, Vec2 position, Vec2 direction, Mask lanes) const;
  // Emission::pdf of a ray whose direction makes an angle of that cosine with the normal.
  Float pdf_emission(Int light, Float cosine, Mask lanes) const {
    return gather(pdf_area_.data(), light, lanes) * xsimd::max(cosine * Float(kInvPi), Float(0.F));
  }
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
  };

  void add_shape(const scene::SceneDescription& description, size_t shape);
  double mean_weight(int light, const scene::Colour& radiance) const;
  Mask of_kind(Int light, geometry::AnalyticKind kind, Mask lanes) const;
  Mask analytic(Int light, Mask lanes) const;
  Vec3 column3(Int light, int first, Mask lanes) const;
  Point uniform_point(Int light, Vec2 u, Mask lanes) const;
  void move_to_disk(Int light, Vec2 u, Mask disk, Point& point) const;
  void move_to_cylinder(Int light, Vec2 u, Mask cylinder, Point& point) const;
  void move_to_sphere(Int light, Vec2 u, Mask sphere, Point& point) const;
  Mask move_to_cap(Int light, const Vec3& reference, Vec2 u, Mask sphere, Point& point,
                   Float& pdf_solid_angle) const;
  Mask outside_sphere(Int light, const Vec3& reference, Mask sphere, Float& one_minus_cos) const;
  geometry::Surface surface_of(Int light, const Point& point, Mask lanes) const;
  Spectrum radiance(Int shape, const geometry::SurfacePoint& point, Mask lanes) const;
  Float sign_of(Int light, Mask lanes) const;

  const geometry::Primitives& primitives_;
  const texture::Textures& textures_;
  // By light.
  std::vector<int32_t> primitive_;
  std::vector<int32_t> shape_;
  std::vector<float> pdf_area_;  // of a uniform point: 1 / area
  std::vector<double> powers_;
  // By shape.
  std::vector<float> radiance_;       // 3 per shape, 0 where it is no light
  std::vector<int32_t> texture_;      // kNone without
  std::vector<int32_t> first_light_;  // the shape's first; kNone where it is no light
  bool textured_ = false;
  bool smooth_ = false;  // some light has vertex normals
  bool has_analytic_ = false;
};

}  // namespace metrofarm::emitter
