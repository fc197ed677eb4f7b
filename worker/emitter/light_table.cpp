#include "emitter/light_table.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "emitter/lookup.h"

namespace metrofarm::emitter {
namespace {

// Of a sphere around the scene's box, as Mitsuba's; 1 where there is nothing.
double scene_radius(const geometry::Primitives& primitives) {
  const geometry::Bounds box = geometry::bounds_of(primitives);
  if (!(box.upper[0] >= box.lower[0])) return 1;
  const auto extent = [&](int k) { return double(box.upper[k]) - box.lower[k]; };
  const double radius = 0.5 * std::hypot(extent(0), extent(1), extent(2));
  return radius > 0 && std::isfinite(radius) ? radius : 1;
}

void blend(Mask here, const LightSample& s, LightSample& result) {
  result.direction = select(here, s.direction, result.direction);
  result.distance = select(here, s.distance, result.distance);
  result.value = select(here, s.value, result.value);
  result.pdf_solid_angle = select(here, s.pdf_solid_angle, result.pdf_solid_angle);
  result.valid = result.valid | (s.valid & here);
  result.delta = result.delta | (s.delta & here);
}

Mask below(Int i, int32_t end) {
  return as_mask(_mm256_cmpgt_epi32(_mm256_set1_epi32(end), i));
}

}  // namespace

LightTable::LightTable(const scene::SceneDescription& description,
                       const geometry::Primitives& primitives, const texture::Images& images,
                       const texture::Textures& textures)
    : areas_(description, primitives, textures),
      deltas_(description.emitters, scene_radius(primitives), textures),
      environment_(description.emitters, scene_radius(primitives), images) {
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

LightSample LightTable::sample(const Vec3& reference, Float choice, Vec2 position,
                               Mask lanes) const {
  LightSample result;
  if (empty()) return result;
  const auto count = static_cast<int32_t>(cdf_.size());
  const Int light = find_in_cdf(cdf_.data(), Int(0), count, choice, lanes).index;
  const int32_t first_delta = areas_.count(), first_part = first_delta + deltas_.count();
  const Mask area = lanes & below(light, first_delta);
  const Mask environment = lanes & ~below(light, first_part);
  const Mask delta = lanes & ~area & ~environment;
  if (any(area)) blend(area, areas_.sample(light, reference, position, area), result);
  if (any(delta)) blend(delta, deltas_.sample(light - Int(first_delta), reference, delta), result);
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
