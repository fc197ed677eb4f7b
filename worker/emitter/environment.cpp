#include "emitter/environment.h"

#include <limits>
#include <numbers>

#include "emitter/light_weight.h"

namespace metrofarm::emitter {

namespace {

constexpr float kUniformPdf = 0.25F * kInvPi;

}  // namespace

Environment::Environment(const std::vector<scene::Emitter>& emitters, const BoundingSphere& scene,
                         const texture::Images& images)
    : scene_(scene) {
  scene::Rgb sum = {0, 0, 0};
  for (const scene::Emitter& emitter : emitters) {
    if (const auto* constant = std::get_if<scene::ConstantEmitter>(&emitter.model)) {
      for (int k = 0; k < 3; ++k) sum[k] += constant->radiance[k];
    } else if (const auto* map = std::get_if<scene::EnvironmentEmitter>(&emitter.model)) {
      maps_.emplace_back(*map, images);
      if (!(maps_.back().mean_weight() > 0)) maps_.pop_back();
    }
  }
  constant_ = splat(sum[0], sum[1], sum[2]);
  weight_of_constant_ = weight_of(sum);
  // What crosses the disk of the scene's radius, from every direction.
  const double etendue = std::numbers::pi * scene.radius * scene.radius * 4 * std::numbers::pi;
  if (has_constant()) powers_.push_back(etendue * weight_of_constant_);
  for (const EnvironmentMap& map : maps_) powers_.push_back(etendue * map.mean_weight());
  picks_.assign(powers_.size(), 0.F);
  emission_picks_ = picks_;
}

void Environment::set_picks(int part, double for_sample, double for_emit) {
  picks_[part] = static_cast<float>(for_sample);
  emission_picks_[part] = static_cast<float>(for_emit);
}

Spectrum Environment::radiance(const Vec3& direction, Mask lanes) const {
  Spectrum sum = keep(lanes, constant_);
  for (const EnvironmentMap& map : maps_) sum = sum + map.radiance(direction, lanes);
  return sum;
}

Float Environment::mixture(const std::vector<float>& picks, const Vec3& direction,
                           Mask lanes) const {
  size_t part = 0;
  Float pdf(0.F);
  if (has_constant()) pdf = keep(lanes, Float(picks[part++] * kUniformPdf));
  for (const EnvironmentMap& map : maps_)
    pdf = pdf + Float(picks[part++]) * map.pdf_solid_angle(direction, lanes);
  return pdf;
}

Vec3 Environment::direction_from(Int part, Vec2 u, Mask lanes) const {
  Vec3 direction = splat(0.F);
  int32_t first_map = 0;
  if (has_constant()) {
    first_map = 1;
    direction = square_to_sphere(u);
  }
  for (size_t i = 0; i < maps_.size(); ++i) {
    const Mask mine = lanes & equal(part, Int(first_map + static_cast<int32_t>(i)));
    if (any(mine)) direction = select(mine, maps_[i].sample(u, mine), direction);
  }
  return direction;
}

LightSample Environment::sample(Int part, Vec2 u, Mask lanes) const {
  LightSample s;
  s.direction = direction_from(part, u, lanes);
  s.distance = Float(std::numeric_limits<float>::infinity());
  const Spectrum found = radiance(s.direction, lanes);
  const Float pdf = pdf_solid_angle(s.direction, lanes);
  s.valid = lanes & (pdf > Float(0.F)) & not_black(found);
  s.pdf_solid_angle = keep(s.valid, pdf);
  s.value = keep(s.valid, found / pdf);
  return s;
}

Emission Environment::emit(Int part, Vec2 position, Vec2 direction, Mask lanes) const {
  const Vec3 from = direction_from(part, direction, lanes);
  Emission e;
  e.direction = -from;
  e.origin = scene_.point_before(e.direction, position);
  e.position = e.origin;
  const Spectrum found = radiance(from, lanes);
  e.pdf = pdf_emission(from, lanes);
  e.valid = lanes & (e.pdf > Float(0.F)) & not_black(found);
  e.power = keep(e.valid, found / e.pdf);
  return e;
}

uint64_t Environment::bytes() const {
  uint64_t sum = 0;
  for (const EnvironmentMap& map : maps_) sum += map.bytes();
  return sum;
}

}  // namespace metrofarm::emitter
