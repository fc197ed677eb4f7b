#include "emitter/light_table.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "emitter/lookup.h"

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
}

Mask below(Int i, int32_t end) {
  return as_mask(_mm256_cmpgt_epi32(_mm256_set1_epi32(end), i));
}

}  // namespace

LightTable::LightTable(const scene::SceneDescription& description,
                       const geometry::Primitives& primitives, const texture::Images& images,
                       const texture::Textures& textures)
    : scene_(bounding_sphere(primitives)),
      areas_(description, primitives, textures),
      deltas_(description.emitters, scene_, textures),
      environment_(description.emitters, scene_, images) {
  make_distribution();
}

void LightTable::make_distribution() {
  std::vector<double> powers = areas_.powers();
  powers.insert(powers.end(), deltas_.powers().begin(), deltas_.powers().end());
  powers.insert(powers.end(), environment_.powers().begin(), environment_.powers().end());
  areas_.forget_powers();
  deltas_.forget_powers();
  if (std::none_of(powers.begin(), powers.end(), [](double p) { return p > 0; })) return;
  METROFARM_CHECK(powers.size() < size_t{1} << 23);
  cdf_.resize(powers.size());
  pick_.resize(powers.size());
  quantize_cdf(powers, cdf_, pick_);
  const int first_part = areas_.count() + deltas_.count();
  for (int part = 0; part < environment_.count(); ++part)
    environment_.set_pick(part, pick_[first_part + part]);
}

LightTable::Kinds LightTable::kinds_of(Int light, Mask lanes) const {
  const Mask area = lanes & below(light, areas_.count());
  const Mask environment = lanes & ~below(light, areas_.count() + deltas_.count());
  return {area, lanes & ~area & ~environment, environment};
}

LightSample LightTable::sample(const Vec3& reference, Float choice, Vec2 position,
                               Mask lanes) const {
  LightSample result;
  if (empty()) return result;
  const auto count = static_cast<int32_t>(cdf_.size());
  const Int light = find_in_cdf(cdf_.data(), Int(0), count, choice, lanes).index;
  const int32_t first_part = areas_.count() + deltas_.count();
  const auto [area, delta, environment] = kinds_of(light, lanes);
  result.light = light;
  if (any(area)) blend(area, areas_.sample(light, reference, position, area), result);
  if (any(delta)) blend(delta, deltas_.sample(delta_index(light), reference, delta), result);
  const Float pick = gather(pick_.data(), light, lanes);
  result.value = keep(result.valid, result.value / pick);
  result.pdf_solid_angle = result.pdf_solid_angle * pick;
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

Float LightTable::pdf_of_hit(const Vec3& reference, const geometry::RayHits& hits,
                             const geometry::Surface& surface, const Vec3& direction,
                             Mask lanes) const {
  const Mask lit = areas_.radiates(surface.shape, lanes);
  if (none(lit)) return Float(0.F);
  const Int light = areas_.light_at(surface.shape, hits.primitive, lit);
  return gather(pick_.data(), light, lit) * areas_.pdf(light, reference, surface, direction, lit);
}

uint64_t LightTable::bytes() const {
  return areas_.bytes() + deltas_.bytes() + environment_.bytes() +
         (cdf_.capacity() + pick_.capacity()) * sizeof(float);
}

}  // namespace metrofarm::emitter
