#include "transport/interaction.h"

#include <limits>

namespace metrofarm::transport {

using primary_space::Pair;
using primary_space::SampleSource;

Vec2 sample_lens(const sensor::Camera& camera, SampleSource& source, Mask lanes) {
  if (!camera.has_lens()) return {Float(0.5F), Float(0.5F)};
  const Pair lens = source.pair(primary_space::kLensSlot, lanes);
  return {lens.first, lens.second};
}

FilmPoint sample_film(const sensor::Camera& camera, SampleSource& source,
                      const RasterWindow& window, Mask lanes) {
  const Pair film = source.pair(primary_space::kFilmSlot, lanes);
  return {window.x + film.first * window.width, window.y + film.second * window.height,
          sample_lens(camera, source, lanes), sample_time(camera, source, window, lanes)};
}

Float sample_time(const sensor::Camera& camera, SampleSource& source, const RasterWindow& window,
                  Mask lanes) {
  if (!camera.has_time()) return Float(0.F);
  const Float u = source.pair(primary_space::kTimeSlot, lanes).first;
  Float y(0.F);
  if (camera.shutter().rolls())
    y = window.y + source.pair(primary_space::kFilmSlot, lanes).second * window.height;
  return camera.shutter().time(u, y);
}

void find_surface(const Scene& scene, const Vec3& origin, const Vec3& direction, Interaction& v) {
  v.surface = geometry::surface_at(scene.primitives(), scene.placements(), v.hits, origin,
                                   direction, scene.surface_needs());
  v.frame = frame_around(v.surface.shading_normal);
  if (!scene.surface_needs().tangents) return;
  // Gram-Schmidt; a tangent along the normal keeps the arbitrary frame.
  const Vec3& n = v.frame.n;
  const Vec3 s = v.surface.dp_du - n * dot(n, v.surface.dp_du);
  const Mask usable = length_squared(s) > Float(0.F);
  v.frame.s = select(usable, normalize(s), v.frame.s);
  v.frame.t = cross(n, v.frame.s);
}

void show_material(const Scene& scene, const Vec3& direction, Float choice, Mask lanes,
                   Interaction& v) {
  const bsdf::Materials& materials = scene.materials();
  v.wo = v.frame.to_local(-direction);
  bsdf::ShadingPoint at{.point = v.surface.point, .dp_du = {}, .dp_dv = {}, .wo = v.wo};
  if (materials.needs().tangents) {
    at.dp_du = v.frame.to_local(v.surface.dp_du);
    at.dp_dv = v.frame.to_local(v.surface.dp_dv);
  }
  const Int bsdf = gather(scene.primitives().bsdf_of.data(), v.surface.shape, lanes);
  v.lobe = materials.show(bsdf, at, choice, lanes);
  const Float turn = select(v.lobe.turned, Float(-1.F), Float(1.F));
  v.frame.n = v.frame.n * turn;
  v.wo.z = v.wo.z * turn;
  v.receiver = {v.surface.position, keep(materials.one_sided(v.lobe, lanes), v.frame.n),
                v.hits.time};
}

Mask unoccluded(const Scene& scene, const Interaction& v, const Vec3& direction, Float distance,
                Mask lanes) {
  const Vec3 origin = v.origin_towards(direction);
  const Mask far = distance > Float(std::numeric_limits<float>::max());
  const Vec3 to_end = v.surface.position + direction * select(far, Float(0.F), distance) - origin;
  const Float t_max = select(far, distance, Float(kShadowRayEnd));
  return lanes & ~scene.tracer().occluded(lanes, origin, select(far, direction, to_end), t_max,
                                          v.hits.time);
}

}  // namespace metrofarm::transport
