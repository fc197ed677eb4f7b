// Rays that leave lights, and how likely they are: what bidirectional methods ask a LightTable.
#include "emitter/light_table.h"

namespace metrofarm::emitter {
namespace {

void blend(Mask here, const Emission& e, Emission& result) {
  result.origin = select(here, e.origin, result.origin);
  result.direction = select(here, e.direction, result.direction);
  result.power = select(here, e.power, result.power);
  result.position = select(here, e.position, result.position);
  result.normal = select(here, e.normal, result.normal);
  result.cosine = select(here, e.cosine, result.cosine);
  result.pdf = select(here, e.pdf, result.pdf);
  result.valid = result.valid | (e.valid & here);
  result.delta = result.delta | (e.delta & here);
}

}  // namespace

Emission LightTable::emit(Float choice, Vec2 position, Vec2 direction, Float time,
                          Mask lanes) const {
  Emission result;
  if (empty()) return result;
  const LightChoice chosen = by_power_.choose(choice, lanes);
  const Int light = chosen.light;
  const auto [area, delta, environment] = kinds_of(light, lanes);
  result.light = light;
  result.time = time;
  if (any(area)) blend(area, areas_.emit(light, position, direction, time, area), result);
  if (any(delta))
    blend(delta, deltas_.emit(delta_index(light), position, direction, time, delta), result);
  result.power = keep(result.valid, result.power / chosen.probability);
  result.pdf = result.pdf * chosen.probability;
  // The environment knows the probabilities of its parts.
  if (any(environment)) {
    const Int part = delta_index(light) - Int(deltas_.count());
    blend(environment, environment_.emit(part, position, direction, environment), result);
  }
  return result;
}

Float LightTable::direct_density(const Emission& e, const Receiver& receiver, Mask lanes) const {
  const auto [area, delta, environment] = kinds_of(e.light, lanes);
  const Vec3& reference = receiver.position;
  Float density = selection_.probability(e.light, receiver, lanes);
  if (any(area)) {
    geometry::Surface surface;
    surface.position = e.position;
    surface.geometric_normal = e.normal;
    const Float pdf = areas_.pdf(e.light, receiver, surface, -e.direction, area);
    density = select(area, density * pdf * e.cosine, density);
  }
  if (any(delta)) {
    const Mask at_position = delta & ~deltas_.parallel(delta_index(e.light), delta);
    density = select(at_position, density * length_squared(reference - e.position), density);
  }
  if (any(environment))
    density = select(environment, environment_.pdf_solid_angle(-e.direction, environment), density);
  return density;
}

Float LightTable::emission_over_direct(const LightSample& s, Mask lanes) const {
  const auto [area, delta, environment] = kinds_of(s.light, lanes);
  const Float pick = by_power_.probability(s.light, lanes);
  Float ratio(0.F);
  if (any(area)) {
    // The cosine of both is left out.
    const Mask front = area & (s.cosine > Float(0.F));
    ratio = keep(front, pick * areas_.pdf_emission(s.light, Float(1.F), s.stretch, area) /
                            s.pdf_solid_angle);
  }
  if (any(delta)) {
    const Int light = delta_index(s.light);
    const Float pdf = deltas_.pdf_emission(light, -s.direction, s.time, delta);
    const Mask far = deltas_.parallel(light, delta);
    const Float per_pick = pick * pdf / s.pick;
    ratio = select(delta, select(far, per_pick, per_pick / sqr(s.distance)), ratio);
  }
  if (any(environment)) {
    const Float pdf = environment_.pdf_emission(s.direction, environment);
    ratio = select(environment, pdf / s.pdf_solid_angle, ratio);
  }
  return ratio;
}

HitDensity LightTable::density_of_hit(const Receiver& receiver, const geometry::RayHits& hits,
                                      const geometry::Surface& surface, const Vec3& direction,
                                      Mask lanes) const {
  HitDensity d;
  const Mask lit = areas_.radiates(surface.shape, lanes);
  if (none(lit) || empty()) return d;
  const Int light = areas_.light_at(surface.shape, hits.primitive, lit);
  const Vec3& reference = receiver.position;
  const Float cosine = -dot(direction, surface.geometric_normal);
  const Float solid_angle = areas_.pdf(light, receiver, surface, direction, lit);
  const Float distance2 = length_squared(surface.position - reference);
  const Float stretch = areas_.stretch(light, surface.geometric_normal, receiver.time, lit);
  d.direct = keep(lit, selection_.probability(light, receiver, lit) * solid_angle *
                           xsimd::abs(cosine) / distance2);
  d.emission = keep(
      lit, by_power_.probability(light, lit) * areas_.pdf_emission(light, cosine, stretch, lit));
  return d;
}

HitDensity LightTable::density_of_environment(const Vec3& direction, Mask lanes) const {
  const Float direct = environment_.pdf_solid_angle(direction, lanes);
  return {direct, environment_.pdf_emission(direction, lanes)};
}

}  // namespace metrofarm::emitter
