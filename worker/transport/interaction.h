// What a ray meets, as path tracing from the eye and from lights both need it.
#pragma once

#include "primary_space/sample_source.h"
#include "sensor/camera.h"
#include "transport/estimator.h"
#include "transport/scene.h"

namespace metrofarm::transport {

// A shadow ray stops short of its end by what rounding can move the end of a long segment.
inline constexpr float kShadowRayEnd = 1.F - 32 * 0x1p-23F;

// Survival in Russian roulette never reaches 1, so that every path ends.
inline constexpr float kLargestSurvival = 0.95F;

// Power heuristic with exponent 2 (Veach 1997, section 9.2.4), in a form that cannot overflow:
// 1 / (1 + (b / a)^2).
inline Float power_heuristic(Float a, Float b) {
  return Float(1.F) / (Float(1.F) + sqr(b / a));
}

// Where a path begins on the film and the lens.
struct FilmPoint {
  Float x, y;  // raster, pixels
  Vec2 lens;
  Float time = Float(0.F);  // see geometry::Tracer
};
FilmPoint sample_film(const sensor::Camera& camera, primary_space::SampleSource& source,
                      const RasterWindow& window, Mask lanes);
// The middle of the lens where there is none, without asking the source.
Vec2 sample_lens(const sensor::Camera& camera, primary_space::SampleSource& source, Mask lanes);
// When the path happens, all of it, whichever end is made first; 0 where it makes no difference,
// without asking the source. Rows of a rolling shutter take theirs from the place on the film.
Float sample_time(const sensor::Camera& camera, primary_space::SampleSource& source,
                  const RasterWindow& window, Mask lanes);

// A vertex of a path; valid in the lanes that hit something.
struct Interaction {
  geometry::RayHits hits;
  geometry::Surface surface;
  Frame frame;  // shading frame, turned where the material is two-sided
  Vec3 wo;      // towards where the ray came from, in the frame
  bsdf::ShownLobe lobe;
  emitter::Receiver receiver;  // as which it asks for lights

  // Whose cosines the material's values hold: the one that a map has bent, where it has.
  Vec3 shading_normal() const {
    if (none(lobe.bent)) return frame.n;
    return select(lobe.bent, frame.to_world(lobe.inner.n), frame.n);
  }
  // Where a new ray towards `direction` starts.
  Vec3 origin_towards(const Vec3& direction) const {
    return geometry::offset_origin(surface.position, surface.geometric_normal, surface.offset,
                                   direction);
  }
};

// Looks up the surface at the hits of a ray, and its shading frame.
void find_surface(const Scene& scene, const Vec3& origin, const Vec3& direction, Interaction& v);

// Asks the material what it is here, and turns the frame for two-sided ones. choice: uniform, picks
// a component of mixed materials. Requires: find_surface().
void show_material(const Scene& scene, const Vec3& direction, Float choice, Mask lanes,
                   Interaction& v);

// Lanes in which nothing lies between the vertex and a point `distance` away along `direction`
// (unit; infinite: nothing at all in that direction). The shadow ray runs from the offset origin to
// the very point: the offset turns it by less than rounding does.
Mask unoccluded(const Scene& scene, const Interaction& v, const Vec3& direction, Float distance,
                Mask lanes);

}  // namespace metrofarm::transport
