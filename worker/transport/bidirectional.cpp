#include "transport/bidirectional.h"

#include <algorithm>

#include "transport/adjoint.h"

namespace metrofarm::transport {

using diagnostics::Place;
using primary_space::Decision;
using primary_space::Pair;
using primary_space::SampleSource;
using primary_space::vertex_slot;

namespace {

Float cosine_at(const Interaction& v, const Vec3& direction) {
  return xsimd::abs(dot(v.surface.geometric_normal, direction));
}

}  // namespace

Mask Technique::light_goes_on(int light_edges) const {
  return all ? all_lanes() : less(Int(light_edges), light_vertices - Int(1));
}

Mask Technique::eye_goes_on(int eye_edges) const {
  return all ? all_lanes() : less(Int(eye_edges), edges - light_vertices);
}

BidirectionalTracer::BidirectionalTracer(const Scene& scene, const sensor::Camera& camera,
                                         const BidirectionalSettings& settings,
                                         const RasterWindow& raster)
    : scene_(scene),
      camera_(camera),
      settings_(settings),
      raster_(raster),
      raster_area_(raster.width * raster.height),
      area_unit_(sqr(Float(scene.lights().scene_radius()))) {
  const bool limited = settings.max_depth >= 0 && settings.max_depth < primary_space::kLongestPath;
  depth_limit_ = limited ? settings.max_depth : primary_space::kLongestPath;
}

void BidirectionalTracer::trace(SampleSource& source, const RasterWindow& window, Mask lanes,
                                Contribution& out) {
  trace_technique(source, window, {}, lanes, out);
}

void BidirectionalTracer::trace_technique(SampleSource& source, const RasterWindow& window,
                                          const Technique& technique, Mask lanes,
                                          Contribution& out) {
  begin(lanes, out);
  Sample sample{.source = source,
                .window = window,
                .technique = technique,
                .lanes = lanes,
                .out = out,
                .film = {}};
  sample.film.lens = sample_lens(camera_, source, lanes);
  sample.film.time = sample_time(camera_, source, window, lanes);
  trace_light(sample);
  trace_eye(sample);
  expose(camera_, out);
}

void BidirectionalTracer::trace_eye(Sample& sample) {
  Subpath eye{.end = End::kEye, .active = sample.lanes & sample.technique.eye_goes_on(0)};
  if (none(eye.active)) return;
  sample.film = sample_film(camera_, sample.source, sample.window, eye.active);
  sample.out.add(0, {sample.film.x, sample.film.y, splat(0.F)}, eye.active);
  const sensor::CameraRay ray =
      camera_.ray(sample.film.x, sample.film.y, sample.film.lens, sample.film.time);
  eye.origin = ray.origin;
  eye.direction = ray.direction;
  for (int edges = 1; edges <= depth_limit_ && any(eye.active); ++edges) {
    Interaction v;
    sample.out.edges = select(eye.active, Int(edges), sample.out.edges);
    count_rays(eye.active);
    v.hits = scene_.tracer().intersect(eye.active, eye.origin, eye.direction, sample.film.time);
    if (edges == 1) v.hits.hit = v.hits.hit & (v.hits.t <= ray.t_max);
    add_environment(sample, eye, eye.active & ~v.hits.hit, edges);
    eye.active = v.hits.hit;
    if (none(eye.active)) return;
    look_up(sample, eye, edges - 1, v);
    const Float cosine = cosine_at(v, eye.direction);
    eye.active = eye.active & (cosine > Float(0.F));
    if (edges == 1) {
      const Float importance =
          camera_.raster_per_area(ray, v.hits.t) * row_weight(sample, sample.film.y);
      eye.mis.last = sqr(raster_area_ / (importance * cosine * area_unit_));
    } else {
      eye.mis.arrive(length_squared(v.surface.position - eye.from.position) / area_unit_, cosine);
    }
    add_emission(sample, eye, v, edges);
    if (edges == depth_limit_) return;
    add_light_sample(sample, eye, v, edges);
    connect(sample, eye, v, edges);
    eye.active = eye.active & sample.technique.eye_goes_on(edges);
    if (any(eye.active)) scatter(sample, eye, v, edges);
  }
}

// By how much likelier than another a row of that raster position is exposed at the sample's time.
Float BidirectionalTracer::row_weight(const Sample& sample, Float raster_y) const {
  if (!camera_.has_time() || !camera_.shutter().rolls()) return Float(1.F);
  return camera_.shutter().row_weight(sample.film.time, raster_y, raster_.y, raster_.height);
}

void BidirectionalTracer::look_up(Sample& sample, const Subpath& path, int vertex, Interaction& v) {
  find_surface(scene_, path.origin, path.direction, v);
  Float choice(0.F);
  if (scene_.materials().wants_choice()) {
    const auto slot = vertex_slot(static_cast<int>(path.end), vertex, Decision::kLight);
    choice = sample.source.pair(slot, path.active).second;
  }
  show_material(scene_, path.direction, choice, path.active, v);
}

BidirectionalTracer::Scattering BidirectionalTracer::scattering(End end, const Interaction& v,
                                                                const Vec3& direction,
                                                                Mask lanes) const {
  const bool eye = end == End::kEye;
  const auto forward = eye ? bsdf::Transport::kRadiance : bsdf::Transport::kImportance;
  const auto backward = eye ? bsdf::Transport::kImportance : bsdf::Transport::kRadiance;
  const Vec3 wi = v.frame.to_local(direction);
  const bsdf::Evaluation e = scene_.materials().evaluate(v.lobe, lanes, v.wo, wi, forward);
  const bsdf::Evaluation back = scene_.materials().evaluate(v.lobe, lanes, wi, v.wo, backward);
  if (eye) return {e.value, e.pdf_solid_angle, back.pdf_solid_angle};
  const Float factor = adjoint_factor(v.surface.geometric_normal, v.shading_normal(),
                                      v.frame.to_world(v.wo), direction);
  return {keep(not_black(e.value), e.value * factor), e.pdf_solid_angle, back.pdf_solid_angle};
}

// Chooses the next direction, then lets the roulette decide whether to follow it.
void BidirectionalTracer::scatter(Sample& sample, Subpath& path, const Interaction& v, int edges) {
  const bool eye = path.end == End::kEye;
  const int vertex = eye ? edges - 1 : edges;
  const int subpath = static_cast<int>(path.end);
  const Pair lobe = sample.source.pair(vertex_slot(subpath, vertex, Decision::kLobe), path.active);
  const Pair u =
      sample.source.pair(vertex_slot(subpath, vertex, Decision::kDirection), path.active);
  const bsdf::Materials& materials = scene_.materials();
  const bsdf::Sample s =
      materials.sample(v.lobe, path.active, v.wo, {lobe.first, {u.first, u.second}},
                       eye ? bsdf::Transport::kRadiance : bsdf::Transport::kImportance);
  path.active = path.active & s.valid;
  path.direction = normalize(v.frame.to_world(s.wi));
  path.origin = v.origin_towards(path.direction);
  path.from = v.receiver;
  path.eta2 = path.eta2 * sqr(s.eta);
  Spectrum weight = s.weight;
  const Float cosine = cosine_at(v, path.direction);
  path.active = path.active & (cosine > Float(0.F));
  if (!eye) {
    weight = weight * adjoint_factor(v.surface.geometric_normal, v.shading_normal(),
                                     v.frame.to_world(v.wo), path.direction);
  }
  const Mask smooth = path.active & ~s.delta;
  Float reverse(0.F);
  if (any(smooth)) {
    reverse = materials
                  .evaluate(v.lobe, smooth, s.wi, v.wo,
                            eye ? bsdf::Transport::kImportance : bsdf::Transport::kRadiance)
                  .pdf_solid_angle;
  }
  path.mis.scatter(s.pdf_solid_angle, reverse, cosine, s.delta);
  path.throughput = path.throughput * weight;
  // A throughput that is no colour ends the path here, where its cause is known.
  path.throughput = quarantine(path.throughput, path.active, Place::kScattering, edges);
  path.active = path.active & (max_component(path.throughput) > Float(0.F));
  if (sample.technique.all && edges >= settings_.rr_depth) roulette(path, lobe.second, weight);
}

// A light subpath's throughput has the unit of power, so what the vertex keeps of it decides.
void BidirectionalTracer::roulette(Subpath& path, Float u, const Spectrum& weight) const {
  const Float brightness =
      path.end == End::kEye ? max_component(path.throughput) * path.eta2 : max_component(weight);
  const Float survival = xsimd::min(brightness, Float(kLargestSurvival));
  path.active = path.active & (u < survival);
  path.throughput = path.throughput / survival;
}

void BidirectionalTracer::add_environment(Sample& sample, const Subpath& eye, Mask missed,
                                          int edges) {
  const emitter::LightTable& lights = scene_.lights();
  if (!lights.has_environment() || edges < settings_.min_depth) return;
  if (edges == 1 && settings_.hide_emitters) return;
  missed = missed & sample.technique.includes(edges, 0);
  if (none(missed)) return;
  Float weight(1.F);
  if (edges > 1) {
    const emitter::HitDensity d = lights.density_of_environment(eye.direction, missed);
    weight = Float(1.F) / (Float(1.F) + sqr(d.direct) * eye.mis.last +
                           sqr(d.emission * area_unit_) * eye.mis.earlier);
  }
  const Spectrum found = eye.throughput * lights.environment(eye.direction, missed) * weight;
  add(sample, found, missed, Place::kEnvironment, edges);
}

void BidirectionalTracer::add_emission(Sample& sample, const Subpath& eye, const Interaction& v,
                                       int edges) {
  if (edges < settings_.min_depth || (edges == 1 && settings_.hide_emitters)) return;
  const Mask wanted = eye.active & sample.technique.includes(edges, 0);
  if (none(wanted)) return;
  const emitter::LightTable& lights = scene_.lights();
  const Spectrum emitted = lights.emitted(v.surface, eye.direction, wanted);
  const Mask lit = wanted & not_black(emitted);
  if (none(lit)) return;
  Float weight(1.F);
  if (edges > 1) {
    const emitter::HitDensity d =
        lights.density_of_hit(eye.from, v.hits, v.surface, eye.direction, lit);
    weight = Float(1.F) / (Float(1.F) + sqr(d.direct * area_unit_) * eye.mis.last +
                           sqr(d.emission * area_unit_) * eye.mis.earlier);
  }
  const Spectrum found = eye.throughput * emitted * weight;
  add(sample, found, lit, Place::kEmission, edges);
}

void BidirectionalTracer::add_light_sample(Sample& sample, const Subpath& eye, const Interaction& v,
                                           int edges) {
  const emitter::LightTable& lights = scene_.lights();
  if (lights.empty() || edges + 1 < settings_.min_depth) return;
  const Mask wanted = eye.active & sample.technique.includes(edges + 1, 1);
  const Mask smooth = scene_.materials().smooth(v.lobe, wanted);
  if (none(smooth)) return;
  const Pair choice =
      sample.source.pair(primary_space::eye_slot(edges - 1, Decision::kLight), smooth);
  const Pair point =
      sample.source.pair(primary_space::eye_slot(edges - 1, Decision::kLightPoint), smooth);
  const emitter::LightSample light =
      lights.sample(v.receiver, choice.first, {point.first, point.second}, smooth);
  const Mask valid = smooth & light.valid;
  if (none(valid)) return;
  const Scattering e = scattering(End::kEye, v, light.direction, valid);
  const Mask useful = valid & not_black(e.value);
  if (none(useful)) return;
  count_rays(useful);
  const Mask visible = unoccluded(scene_, v, light.direction, light.distance, useful);
  if (none(visible)) return;
  const Float by_bsdf = select(light.delta, Float(0.F), sqr(e.pdf / light.pdf_solid_angle));
  const Float density =
      lights.emission_over_direct(light, visible) * cosine_at(v, light.direction) * area_unit_;
  const Float weight = Float(1.F) / (Float(1.F) + by_bsdf + eye.mis.sum(density, e.reverse_pdf));
  const Spectrum found = eye.throughput * e.value * light.value * weight;
  add(sample, found, visible, Place::kEmitterSample, edges + 1);
}

void BidirectionalTracer::connect(Sample& sample, const Subpath& eye, const Interaction& v,
                                  int edges) {
  if (sample.light_edges == 0) return;
  if (none(scene_.materials().smooth(v.lobe, eye.active))) return;
  const int shortest = std::max(1, settings_.min_depth - edges - 1);
  for (int j = shortest; j <= sample.light_edges && edges + j < depth_limit_; ++j) {
    const LightVertex& light = light_vertices_[j - 1];
    const int total = edges + j + 1;
    const Mask lanes = eye.active & light.lanes & sample.technique.includes(total, j + 1);
    if (none(lanes)) continue;
    const Mask smooth = scene_.materials().smooth(v.lobe, lanes);
    if (any(smooth)) add(sample, joined(eye, v, light, smooth), smooth, Place::kConnection, total);
  }
}

// What light takes from the light vertex over the eye vertex to the camera.
Spectrum BidirectionalTracer::joined(const Subpath& eye, const Interaction& v,
                                     const LightVertex& light, Mask lanes) {
  const Vec3 between = light.at.surface.position - v.surface.position;
  const Float distance2 = length_squared(between);
  const Float distance = xsimd::sqrt(distance2);
  const Vec3 direction = between / distance;
  const Scattering e = scattering(End::kEye, v, direction, lanes);
  const Mask towards = lanes & not_black(e.value) & (distance2 > Float(0.F));
  if (none(towards)) return splat(0.F);
  const Scattering l = scattering(End::kLight, light.at, -direction, towards);
  const Mask useful = towards & not_black(l.value);
  if (none(useful)) return splat(0.F);
  count_rays(useful);
  // To the light vertex's side that faces this one, short of the surface itself.
  const Vec3 to = light.at.origin_towards(-direction) - v.surface.position;
  const Float reach = length(to);
  const Mask visible = unoccluded(scene_, v, to / reach, reach, useful);
  if (none(visible)) return splat(0.F);
  const Float per_area = area_unit_ / distance2;
  const Float eye_finds = e.pdf * cosine_at(light.at, direction) * per_area;
  const Float light_finds = l.pdf * cosine_at(v, direction) * per_area;
  const Float weight = Float(1.F) / (Float(1.F) + light.mis.sum(eye_finds, l.reverse_pdf) +
                                     eye.mis.sum(light_finds, e.reverse_pdf));
  const Spectrum found = eye.throughput * e.value * light.throughput * l.value;
  return keep(visible, found * (weight / distance2));
}

void BidirectionalTracer::add(Sample& sample, const Spectrum& found, Mask lanes, Place place,
                              int edges) {
  sample.out.add(0, {sample.film.x, sample.film.y, quarantine(found, lanes, place, edges)}, lanes);
}

}  // namespace metrofarm::transport
