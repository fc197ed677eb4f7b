// The half of bidirectional path tracing that starts at emitters.
#include "transport/bidirectional.h"

namespace metrofarm::transport {

using diagnostics::Place;
using primary_space::Decision;
using primary_space::light_slot;
using primary_space::Pair;

void BidirectionalTracer::trace_light(Sample& sample) {
  Subpath light{.end = End::kLight, .active = sample.lanes & sample.technique.light_goes_on(0)};
  if (none(light.active) || scene_.lights().empty() || depth_limit_ < 2) return;
  const Pair choice = sample.source.pair(light_slot(0, Decision::kLight), light.active);
  const Pair point = sample.source.pair(light_slot(0, Decision::kLightPoint), light.active);
  const Pair turn = sample.source.pair(light_slot(0, Decision::kDirection), light.active);
  const emitter::Emission emission =
      scene_.lights().emit(choice.first, {point.first, point.second}, {turn.first, turn.second},
                           sample.film.time, light.active);
  light.active = light.active & emission.valid;
  light.origin = emission.origin;
  light.direction = emission.direction;
  light.throughput = emission.power;
  for (int edges = 1; edges < depth_limit_ && any(light.active); ++edges) {
    Interaction v;
    count_rays(light.active);
    v.hits =
        scene_.tracer().intersect(light.active, light.origin, light.direction, sample.film.time);
    light.active = v.hits.hit;
    if (none(light.active)) return;
    look_up(sample, light, edges, v);
    const Float cosine = xsimd::abs(dot(v.surface.geometric_normal, light.direction));
    light.active = light.active & (cosine > Float(0.F));
    if (edges == 1) {
      const Float direct = scene_.lights().direct_density(emission, v.receiver, light.active);
      const Float per_density = Float(1.F) / (emission.pdf * cosine * area_unit_);
      light.mis.last = sqr(direct * per_density);
      light.mis.earlier = select(emission.delta, Float(0.F), sqr(emission.cosine * per_density));
    } else {
      light.mis.arrive(length_squared(v.surface.position - light.from.position) / area_unit_,
                       cosine);
    }
    add_vertex(sample, light, v, edges);
    light.active = light.active & sample.technique.light_goes_on(edges);
    if (edges + 1 < depth_limit_ && any(light.active)) scatter(sample, light, v, edges);
  }
}

// Keeps the vertex for the eye subpath and shows it to the camera.
void BidirectionalTracer::add_vertex(Sample& sample, const Subpath& light, const Interaction& v,
                                     int edges) {
  sample.light_edges = edges;
  if (light_vertices_.size() < static_cast<size_t>(edges)) light_vertices_.resize(edges);
  LightVertex& kept = light_vertices_[edges - 1];
  kept.lanes = scene_.materials().smooth(v.lobe, light.active);
  if (none(kept.lanes)) return;
  kept.at = v;
  kept.throughput = light.throughput;
  kept.mis = light.mis;
  connect_to_camera(sample, kept, edges);
}

void BidirectionalTracer::connect_to_camera(Sample& sample, const LightVertex& v, int edges) {
  if (edges + 1 < settings_.min_depth) return;
  Mask lanes = v.lanes & sample.technique.includes(edges + 1, edges + 1);
  if (none(lanes)) return;
  const Vec3& position = v.at.surface.position;
  const sensor::CameraConnection c = camera_.connect(position, sample.film.lens, sample.film.time);
  const Float x = c.raster_x - raster_.x, y = c.raster_y - raster_.y;
  lanes = lanes & c.valid & (x >= Float(0.F)) & (y >= Float(0.F)) & (x < raster_.width) &
          (y < raster_.height);
  if (none(lanes)) return;
  const Scattering s = scattering(End::kLight, v.at, c.direction, lanes);
  lanes = lanes & not_black(s.value);
  if (none(lanes)) return;
  count_rays(lanes);
  const Vec3 to = c.start - position;
  const Float distance = length(to);
  const Mask visible = unoccluded(scene_, v.at, c.direction, distance, lanes);
  if (none(visible)) return;
  const Float importance = c.raster_per_area * row_weight(sample, c.raster_y) / raster_area_;
  const Float cosine = xsimd::abs(dot(v.at.surface.geometric_normal, c.direction));
  const Float weight =
      Float(1.F) / (Float(1.F) + v.mis.sum(importance * cosine * area_unit_, s.reverse_pdf));
  const Spectrum found = v.throughput * s.value * (importance * weight);
  const size_t i = sample.technique.all ? static_cast<size_t>(edges) : 1;
  sample.out.add(
      i, {c.raster_x, c.raster_y, quarantine(found, visible, Place::kCameraConnection, edges + 1)},
      visible);
}

}  // namespace metrofarm::transport
