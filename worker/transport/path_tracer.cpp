#include "transport/path_tracer.h"

namespace metrofarm::transport {

using diagnostics::Place;
using primary_space::Decision;
using primary_space::eye_slot;
using primary_space::Pair;
using primary_space::SampleSource;

struct PathTracer::State {
  Mask active;
  Vec3 origin, direction;
  Float far;   // of the camera ray
  Float time;  // of the whole path
  Spectrum throughput = splat(1.F);
  Spectrum radiance = splat(0.F);
  Float pdf_solid_angle = Float(0.F);  // of the last scattered direction
  Mask delta = all_lanes();            // the last event left light sampling no chance
  emitter::Receiver receiver{};        // for which light sampling looked
  Float eta2 = Float(1.F);             // product of squared index ratios, undone in the roulette
};

PathTracer::PathTracer(const Scene& scene, const sensor::Camera& camera,
                       const PathSettings& settings)
    : scene_(scene), camera_(camera), settings_(settings) {
  const bool limited = settings.max_depth >= 0 && settings.max_depth < primary_space::kLongestPath;
  depth_limit_ = limited ? settings.max_depth : primary_space::kLongestPath;
}

void PathTracer::trace(SampleSource& source, const RasterWindow& window, Mask lanes,
                       Contribution& out) {
  begin(lanes, out);
  const FilmPoint film = sample_film(camera_, source, window, lanes);
  const sensor::CameraRay ray = camera_.ray(film.x, film.y, film.lens, film.time);

  State path{.active = lanes,
             .origin = ray.origin,
             .direction = ray.direction,
             .far = ray.t_max,
             .time = film.time};
  for (int depth = 1; depth <= depth_limit_ && any(path.active); ++depth) {
    out.edges = select(path.active, Int(depth), out.edges);
    const Interaction vertex = meet(path, source, depth);
    add_emission(path, vertex, depth);
    if (depth == depth_limit_ || none(path.active)) break;
    add_light_sample(path, vertex, source, depth);
    scatter(path, vertex, source, depth);
  }
  out.splats[0] = {film.x, film.y, path.radiance};
  expose(camera_, out);
}

// Follows the rays; lanes that leave the scene see the environment and become inactive.
Interaction PathTracer::meet(State& path, SampleSource& source, int depth) {
  Interaction v;
  count_rays(path.active);
  v.hits = scene_.tracer().intersect(path.active, path.origin, path.direction, path.time);
  if (depth == 1) v.hits.hit = v.hits.hit & (v.hits.t <= path.far);  // the camera's far plane
  const Mask missed = path.active & ~v.hits.hit;
  if (any(missed)) add_environment(path, missed, depth);
  path.active = v.hits.hit;
  if (none(path.active)) return v;

  find_surface(scene_, path.origin, path.direction, v);
  Float choice(0.F);
  if (scene_.materials().wants_choice())
    choice = source.pair(eye_slot(depth - 1, Decision::kLight), path.active).second;
  show_material(scene_, path.direction, choice, path.active, v);
  return v;
}

// Share of a hit that BSDF sampling found and light sampling could have found too.
Float PathTracer::weight_of_hit(Float pdf_bsdf, Float pdf_light, Mask delta) const {
  switch (settings_.light_sampling) {
    case LightSampling::kMis:
      return select(delta, Float(1.F), power_heuristic(pdf_bsdf, pdf_light));
    case LightSampling::kEmitter:
      return select(delta, Float(1.F), Float(0.F));
    case LightSampling::kBsdf:
      return Float(1.F);
  }
  return Float(0.F);
}

void PathTracer::add_environment(State& path, Mask missed, int depth) {
  if (!scene_.lights().has_environment()) return;
  if (depth < settings_.min_depth || (depth == 1 && settings_.hide_emitters)) return;
  const emitter::LightTable& lights = scene_.lights();
  const Mask sampled = missed & ~path.delta;
  const Float pdf_light =
      any(sampled) ? lights.environment_pdf(path.direction, sampled) : Float(0.F);
  const Float weight = weight_of_hit(path.pdf_solid_angle, pdf_light, path.delta);
  const Spectrum found = path.throughput * lights.environment(path.direction, missed) * weight;
  path.radiance = path.radiance + quarantine(found, missed, Place::kEnvironment, depth);
}

void PathTracer::add_emission(State& path, const Interaction& v, int depth) {
  if (none(path.active) || depth < settings_.min_depth) return;
  if (depth == 1 && settings_.hide_emitters) return;
  const Spectrum emitted = scene_.lights().emitted(v.surface, path.direction, path.active);
  const Mask lit = path.active & not_black(emitted);
  if (none(lit)) return;
  const Mask delta = path.delta;
  Float weight(1.F);
  if (any(lit & ~delta)) {
    const Float pdf_light =
        scene_.lights().pdf_of_hit(path.receiver, v.hits, v.surface, path.direction, lit & ~delta);
    weight = weight_of_hit(path.pdf_solid_angle, pdf_light, delta);
  }
  const Spectrum found = path.throughput * emitted * weight;
  path.radiance = path.radiance + quarantine(found, lit, Place::kEmission, depth);
}

void PathTracer::add_light_sample(State& path, const Interaction& v, SampleSource& source,
                                  int depth) {
  if (settings_.light_sampling == LightSampling::kBsdf || scene_.lights().empty()) return;
  if (depth + 1 < settings_.min_depth) return;
  const Mask smooth = scene_.materials().smooth(v.lobe, path.active);
  if (none(smooth)) return;
  const Pair choice = source.pair(eye_slot(depth - 1, Decision::kLight), smooth);
  const Pair point = source.pair(eye_slot(depth - 1, Decision::kLightPoint), smooth);

  const emitter::LightSample light =
      scene_.lights().sample(v.receiver, choice.first, {point.first, point.second}, smooth);
  const Vec3 wi = v.frame.to_local(light.direction);
  const bsdf::Evaluation e = scene_.materials().evaluate(v.lobe, smooth & light.valid, v.wo, wi,
                                                         bsdf::Transport::kRadiance);
  const Mask useful = smooth & light.valid & not_black(e.value);
  if (none(useful)) return;

  count_rays(useful);
  const Mask visible = unoccluded(scene_, v, light.direction, light.distance, useful);
  if (none(visible)) return;
  const bool mis = settings_.light_sampling == LightSampling::kMis;
  const Mask alone = mis ? light.delta : all_lanes();
  const Float weight =
      select(alone, Float(1.F), power_heuristic(light.pdf_solid_angle, e.pdf_solid_angle));
  const Spectrum found = path.throughput * e.value * light.value * weight;
  path.radiance = path.radiance + quarantine(found, visible, Place::kEmitterSample, depth + 1);
}

// Chooses the next direction, then lets the roulette decide whether to follow it.
void PathTracer::scatter(State& path, const Interaction& v, SampleSource& source, int depth) {
  const Pair lobe = source.pair(eye_slot(depth - 1, Decision::kLobe), path.active);
  const Pair direction = source.pair(eye_slot(depth - 1, Decision::kDirection), path.active);
  const bsdf::Sample s = scene_.materials().sample(
      v.lobe, path.active, v.wo, {lobe.first, {direction.first, direction.second}},
      bsdf::Transport::kRadiance);
  path.active = path.active & s.valid;
  path.throughput = path.throughput * s.weight;
  path.eta2 = path.eta2 * sqr(s.eta);
  path.direction = normalize(v.frame.to_world(s.wi));
  path.origin = v.origin_towards(path.direction);
  path.receiver = v.receiver;
  path.pdf_solid_angle = s.pdf_solid_angle;
  path.delta = s.delta;
  // A throughput that is no colour ends the path here, where its cause is known.
  const Mask sound = diagnostics::sound(path.throughput);
  if (any(path.active & ~sound)) {
    diagnostics::report(path.active & ~sound, path.throughput, Place::kScattering, depth,
                        incidents_);
  }
  const Float brightest = max_component(path.throughput);
  path.active = path.active & sound & (brightest > Float(0.F));
  if (depth >= settings_.rr_depth) {
    const Float survival = xsimd::min(brightest * path.eta2, Float(kLargestSurvival));
    path.active = path.active & (lobe.second < survival);
    path.throughput = path.throughput / survival;
  }
}

}  // namespace metrofarm::transport
