#include "transport/path_tracer.h"

#include <limits>

namespace metrofarm::transport {

using diagnostics::Place;
using primary_space::Decision;
using primary_space::eye_slot;
using primary_space::Pair;
using primary_space::SampleSource;

namespace {

// Survival never reaches 1, so that every path ends.
constexpr float kLargestSurvival = 0.95F;

// A shadow ray stops short of its light by what rounding can move the end of a long segment.
constexpr float kShadowRayEnd = 1.F - 32 * 0x1p-23F;

// Power heuristic with exponent 2, in a form that cannot overflow: 1 / (1 + (b / a)^2).
Float power_heuristic(Float a, Float b) {
  return Float(1.F) / (Float(1.F) + sqr(b / a));
}

}  // namespace

struct PathTracer::State {
  Mask active;
  Vec3 origin, direction;
  Float far;  // of the camera ray
  Spectrum throughput = splat(1.F);
  Spectrum radiance = splat(0.F);
  Float pdf_solid_angle = Float(0.F);  // of the last scattered direction
  Mask delta = all_lanes();            // the last event left light sampling no chance
  emitter::Receiver receiver;          // for which light sampling looked
  Float eta2 = Float(1.F);             // product of squared index ratios, undone in the roulette
};

struct PathTracer::Vertex {
  geometry::RayHits hits;
  geometry::Surface surface;
  Frame frame;
  Vec3 wo;
  bsdf::ShownLobe lobe;
  emitter::Receiver receiver;
};

PathTracer::PathTracer(const Scene& scene, const sensor::Camera& camera,
                       const PathSettings& settings)
    : scene_(scene), camera_(camera), settings_(settings) {
  const bool limited = settings.max_depth >= 0 && settings.max_depth < primary_space::kLongestPath;
  depth_limit_ = limited ? settings.max_depth : primary_space::kLongestPath;
}

Contribution PathTracer::trace(SampleSource& source, const RasterWindow& window, Mask lanes) {
  incidents_.clear();
  costs_.paths += __builtin_popcount(bits(lanes));
  const Pair film = source.pair(primary_space::kFilmSlot, lanes);
  Contribution result;
  result.raster_x = window.x + film.first * window.width;
  result.raster_y = window.y + film.second * window.height;
  Vec2 lens{Float(0.5F), Float(0.5F)};
  if (camera_.has_lens()) {
    const Pair p = source.pair(primary_space::kLensSlot, lanes);
    lens = {p.first, p.second};
  }
  const sensor::CameraRay ray = camera_.ray(result.raster_x, result.raster_y, lens);

  State path{.active = lanes, .origin = ray.origin, .direction = ray.direction, .far = ray.t_max};
  for (int depth = 1; depth <= depth_limit_ && any(path.active); ++depth) {
    const Vertex vertex = meet(path, source, depth);
    add_emission(path, vertex, depth);
    if (depth == depth_limit_ || none(path.active)) break;
    add_light_sample(path, vertex, source, depth);
    scatter(path, vertex, source, depth);
  }
  result.radiance = path.radiance;
  return result;
}

// Follows the rays; lanes that leave the scene see the environment and become inactive.
PathTracer::Vertex PathTracer::meet(State& path, SampleSource& source, int depth) {
  Vertex v;
  costs_.rays += __builtin_popcount(bits(path.active));
  v.hits = scene_.tracer().intersect(path.active, path.origin, path.direction);
  if (depth == 1) v.hits.hit = v.hits.hit & (v.hits.t <= path.far);  // the camera's far plane
  const Mask missed = path.active & ~v.hits.hit;
  if (any(missed)) add_environment(path, missed, depth);
  path.active = v.hits.hit;
  if (none(path.active)) return v;

  v.surface = geometry::surface_at(scene_.primitives(), v.hits, path.origin, path.direction,
                                   scene_.surface_needs());
  v.frame = frame_around(v.surface.shading_normal);
  if (scene_.surface_needs().tangents) {
    // Gram-Schmidt; a tangent along the normal keeps the arbitrary frame.
    const Vec3& n = v.frame.n;
    const Vec3 s = v.surface.dp_du - n * dot(n, v.surface.dp_du);
    const Mask usable = length_squared(s) > Float(0.F);
    v.frame.s = select(usable, normalize(s), v.frame.s);
    v.frame.t = cross(n, v.frame.s);
  }
  show(path, v, source, depth);
  return v;
}

// Asks the material what it is here, and turns the frame for two-sided ones.
void PathTracer::show(State& path, Vertex& v, SampleSource& source, int depth) {
  const bsdf::Materials& materials = scene_.materials();
  Float choice(0.F);
  if (materials.wants_choice())
    choice = source.pair(eye_slot(depth - 1, Decision::kLight), path.active).second;
  v.wo = v.frame.to_local(-path.direction);
  bsdf::ShadingPoint at{.point = v.surface.point, .dp_du = {}, .dp_dv = {}, .wo = v.wo};
  if (materials.needs().tangents) {
    at.dp_du = v.frame.to_local(v.surface.dp_du);
    at.dp_dv = v.frame.to_local(v.surface.dp_dv);
  }
  const Int bsdf = gather(scene_.primitives().bsdf_of.data(), v.surface.shape, path.active);
  v.lobe = materials.show(bsdf, at, choice, path.active);
  const Float turn = select(v.lobe.turned, Float(-1.F), Float(1.F));
  v.frame.n = v.frame.n * turn;
  v.wo.z = v.wo.z * turn;
  const Mask one_sided = materials.one_sided(v.lobe, path.active);
  v.receiver = {v.surface.position, keep(one_sided, v.frame.n)};
}

void PathTracer::accumulate(State& path, const Spectrum& contribution, Mask lanes, Place place,
                            int depth) {
  const Mask good = diagnostics::sound(contribution);
  if (any(lanes & ~good)) {
    diagnostics::report(lanes & ~good, contribution, place, depth, incidents_);
  }
  path.radiance = path.radiance + keep(lanes & good, contribution);
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
  if (depth == 1 && settings_.hide_emitters) return;
  const emitter::LightTable& lights = scene_.lights();
  const Mask sampled = missed & ~path.delta;
  const Float pdf_light =
      any(sampled) ? lights.environment_pdf(path.direction, sampled) : Float(0.F);
  const Float weight = weight_of_hit(path.pdf_solid_angle, pdf_light, path.delta);
  const Spectrum found = path.throughput * lights.environment(path.direction, missed) * weight;
  accumulate(path, found, missed, Place::kEnvironment, depth);
}

void PathTracer::add_emission(State& path, const Vertex& v, int depth) {
  if (none(path.active) || (depth == 1 && settings_.hide_emitters)) return;
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
  accumulate(path, path.throughput * emitted * weight, lit, Place::kEmission, depth);
}

void PathTracer::add_light_sample(State& path, const Vertex& v, SampleSource& source, int depth) {
  if (settings_.light_sampling == LightSampling::kBsdf || scene_.lights().empty()) return;
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

  const Mask visible = unoccluded(v, light, useful);
  if (none(visible)) return;
  const bool mis = settings_.light_sampling == LightSampling::kMis;
  const Mask alone = mis ? light.delta : all_lanes();
  const Float weight =
      select(alone, Float(1.F), power_heuristic(light.pdf_solid_angle, e.pdf_solid_angle));
  accumulate(path, path.throughput * e.value * light.value * weight, visible, Place::kEmitterSample,
             depth + 1);
}

// Lanes in which nothing lies between the vertex and the light. The shadow ray runs from the offset
// origin to the very point that was sampled: the offset turns it by less than rounding does.
Mask PathTracer::unoccluded(const Vertex& v, const emitter::LightSample& light, Mask lanes) {
  costs_.rays += __builtin_popcount(bits(lanes));
  const Vec3 origin = geometry::offset_origin(v.surface.position, v.surface.geometric_normal,
                                              v.surface.offset, light.direction);
  const Mask far = light.distance > Float(std::numeric_limits<float>::max());
  const Float distance = select(far, Float(0.F), light.distance);
  const Vec3 to_light = v.surface.position + light.direction * distance - origin;
  const Vec3 direction = select(far, light.direction, to_light);
  const Float t_max = select(far, light.distance, Float(kShadowRayEnd));
  return lanes & ~scene_.tracer().occluded(lanes, origin, direction, t_max);
}

// Chooses the next direction, then lets the roulette decide whether to follow it.
void PathTracer::scatter(State& path, const Vertex& v, SampleSource& source, int depth) {
  const Pair lobe = source.pair(eye_slot(depth - 1, Decision::kLobe), path.active);
  const Pair direction = source.pair(eye_slot(depth - 1, Decision::kDirection), path.active);
  const bsdf::Sample s = scene_.materials().sample(
      v.lobe, path.active, v.wo, {lobe.first, {direction.first, direction.second}},
      bsdf::Transport::kRadiance);
  path.active = path.active & s.valid;
  path.throughput = path.throughput * s.weight;
  path.eta2 = path.eta2 * sqr(s.eta);
  path.direction = normalize(v.frame.to_world(s.wi));
  path.origin = geometry::offset_origin(v.surface.position, v.surface.geometric_normal,
                                        v.surface.offset, path.direction);
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
