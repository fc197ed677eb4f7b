#include "emitter/light_table.h"

#include <algorithm>
#include <cmath>

namespace metrofarm::emitter {
namespace {

void blend(Mask here, const LightSample& s, LightSample& result) {
  result.direction = select(here, s.direction, result.direction);
  result.distance = select(here, s.distance, result.distance);
  result.value = select(here, s.value, result.value);
  result.pdf_solid_angle = select(here, s.pdf_solid_angle, result.pdf_solid_angle);
  result.valid = result.valid | (s.valid & here);
  result.delta = result.delta | (s.delta & here);
  result.cosine = select(here, s.cosine, result.cosine);
  result.stretch = select(here, s.stretch, result.stretch);
}

Mask below(Int i, int32_t end) {
  return as_mask(_mm256_cmpgt_epi32(_mm256_set1_epi32(end), i));
}

}  // namespace

LightTable::LightTable(const scene::SceneDescription& description,
                       const geometry::Primitives& primitives,
                       const geometry::Placements& placements, const texture::Images& images,
                       const texture::Textures& textures)
    : scene_(bounding_sphere(primitives, placements)),
      areas_(description, primitives, placements, textures),
      deltas_(description.emitters, scene_, placements.interval(), textures),
      environment_(description.emitters, scene_, images) {
  make_distributions();
}

void LightTable::make_distributions() {
  std::vector<LightSelection::Light> lights;
  for (int i = 0; i < areas_.count(); ++i) {
    const double power = areas_.powers()[i];
    lights.push_back({power, false, power > 0 ? areas_.bounds(i) : LightBounds{}});
  }
  for (int i = 0; i < deltas_.count(); ++i) {
    const bool far = deltas_.infinitely_far(i);
    lights.push_back({deltas_.powers()[i], far, far ? LightBounds{} : deltas_.bounds(i)});
  }
  for (double power : environment_.powers()) lights.push_back({power, true, {}});
  areas_.forget_powers();
  deltas_.forget_powers();
  std::vector<double> powers;
  powers.reserve(lights.size());
  for (const LightSelection::Light& light : lights) powers.push_back(light.power);
  if (std::none_of(powers.begin(), powers.end(), [](double p) { return p > 0; })) return;
  by_power_ = WeightTable(powers);
  selection_ = LightSelection(lights);
  const size_t first_part = lights.size() - static_cast<size_t>(environment_.count());
  for (int part = 0; part < environment_.count(); ++part)
    environment_.set_picks(part, selection_.probability_infinitely_far(first_part + part),
                           by_power_.probability(first_part + part));
}

LightTable::Kinds LightTable::kinds_of(Int light, Mask lanes) const {
  const Mask area = lanes & below(light, areas_.count());
  const Mask environment = lanes & ~below(light, areas_.count() + deltas_.count());
  return {area, lanes & ~area & ~environment, environment};
}

LightSample LightTable::sample(const Receiver& receiver, Float choice, Vec2 position,
                               Mask lanes) const {
  LightSample result;
  if (empty()) return result;
  const LightChoice chosen = selection_.choose(choice, receiver, lanes);
  const Int light = chosen.light;
  const int32_t first_part = areas_.count() + deltas_.count();
  const auto [area, delta, environment] = kinds_of(light, lanes);
  result.light = light;
  result.time = receiver.time;
  if (any(area)) blend(area, areas_.sample(light, receiver, position, area), result);
  if (any(delta)) blend(delta, deltas_.sample(delta_index(light), receiver, delta), result);
  result.pick = chosen.probability;
  result.value = keep(result.valid, result.value / chosen.probability);
  result.pdf_solid_angle = result.pdf_solid_angle * chosen.probability;
  // The environment knows the probabilities of its parts.
  if (any(environment)) {
    blend(environment, environment_.sample(light - Int(first_part), position, environment), result);
  }
  return result;
}

Spectrum LightTable::emitted(const geometry::Surface& surface, const Vec3& direction,
                             Mask lanes) const {
  return areas_.emitted(surface, direction, lanes);
}

Float LightTable::pdf_of_hit(const Receiver& receiver, const geometry::RayHits& hits,
                             const geometry::Surface& surface, const Vec3& direction,
                             Mask lanes) const {
  const Mask lit = areas_.radiates(surface.shape, lanes);
  if (none(lit) || empty()) return Float(0.F);
  const Int light = areas_.light_at(surface.shape, hits.primitive, lit);
  return selection_.probability(light, receiver, lit) *
         areas_.pdf(light, receiver, surface, direction, lit);
}

uint64_t LightTable::bytes() const {
  return areas_.bytes() + deltas_.bytes() + environment_.bytes() + by_power_.bytes() +
         selection_.bytes();
}

}  // namespace metrofarm::emitter
