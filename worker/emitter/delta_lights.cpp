#include "emitter/delta_lights.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "emitter/light_weight.h"
#include "emitter/linear_map.h"

namespace metrofarm::emitter {
namespace {

// Columns of a light's row.
constexpr int kPosition = 0;      // 3; of parallel light the unit direction towards the light
constexpr int kIntensity = 3;     // 3
constexpr int kWorldToLight = 6;  // 9, row major; turns only
constexpr int kUvScale = 15;      // 2; uv = 1/2 + scale * (x, y) / z
constexpr int kCosCutoff = 17;
constexpr int kCosBeam = 18;
constexpr int kCutoff = 19;         // radians
constexpr int kPerTransition = 20;  // 1 / (cutoff - beam width)
constexpr int kStride = 21;

constexpr double kPiDouble = std::numbers::pi;

double radians(double degrees) {
  return degrees * kPiDouble / 180;
}

void set_position(const scene::Matrix& to_world, float* row) {
  for (int k = 0; k < 3; ++k) row[kPosition + k] = static_cast<float>(to_world[4 * k + 3]);
}

void set_orientation(const scene::Matrix& to_world, float* row) {
  const scene::Linear inverse = inverse_turn(to_world);
  for (int k = 0; k < 9; ++k) row[kWorldToLight + k] = static_cast<float>(inverse[k]);
}

// The integral of a spot's falloff over directions, sr.
double spot_solid_angle(double beam, double cutoff) {
  if (cutoff <= beam) return 2 * kPiDouble * (1 - std::cos(cutoff));
  return 2 * kPiDouble * (1 - (std::sin(cutoff) - std::sin(beam)) / (cutoff - beam));
}

}  // namespace

DeltaLights::DeltaLights(const std::vector<scene::Emitter>& emitters, double scene_radius,
                         const texture::Textures& textures)
    : textures_(textures) {
  for (const scene::Emitter& emitter : emitters) {
    if (const auto* point = std::get_if<scene::PointEmitter>(&emitter.model)) {
      add(*point);
    } else if (const auto* spot = std::get_if<scene::SpotEmitter>(&emitter.model)) {
      add(*spot);
    } else if (const auto* projector = std::get_if<scene::ProjectorEmitter>(&emitter.model)) {
      add(*projector);
    } else if (const auto* parallel = std::get_if<scene::DirectionalEmitter>(&emitter.model)) {
      add(*parallel, scene_radius);
    }
  }
}

// The light's row to be filled in, or none where it is dark.
float* DeltaLights::new_row(Kind kind, const scene::Colour& intensity, double power) {
  if (power == 0) return nullptr;
  kind_.push_back(kind);
  texture_.push_back(intensity.texture);
  powers_.push_back(power);
  shaped_ = shaped_ || kind != kPoint;
  rows_.resize(rows_.size() + kStride, 0.F);
  float* row = &rows_[rows_.size() - kStride];
  for (int k = 0; k < 3; ++k) row[kIntensity + k] = intensity.value[k];
  return row;
}

void DeltaLights::add(const scene::PointEmitter& point) {
  float* row = new_row(kPoint, point.intensity, 4 * kPiDouble * weight_of(point.intensity));
  if (row == nullptr) return;
  for (int k = 0; k < 3; ++k) row[kPosition + k] = static_cast<float>(point.position[k]);
}

void DeltaLights::add(const scene::SpotEmitter& spot) {
  const double cutoff = radians(spot.cutoff_degrees), beam = radians(spot.beam_width_degrees);
  float* row =
      new_row(kSpot, spot.intensity, spot_solid_angle(beam, cutoff) * mean_weight(spot.intensity));
  if (row == nullptr) return;
  set_position(spot.to_world, row);
  set_orientation(spot.to_world, row);
  row[kUvScale] = row[kUvScale + 1] = static_cast<float>(0.5 / std::tan(cutoff));
  row[kCosCutoff] = static_cast<float>(std::cos(cutoff));
  row[kCosBeam] = static_cast<float>(std::cos(beam));
  row[kCutoff] = static_cast<float>(cutoff);
  row[kPerTransition] = cutoff > beam ? static_cast<float>(1 / (cutoff - beam)) : 0.F;
}

void DeltaLights::add(const scene::ProjectorEmitter& projector) {
  const double half_width = std::tan(radians(projector.fov_x_degrees) / 2);
  const double half_height = half_width / projector.aspect;
  // Mitsuba 3.9's plugin takes the image for the radiance of a white diffuser there: times pi.
  scene::Colour irradiance = projector.irradiance;
  for (float& v : irradiance.value) v *= kPi;
  float* row =
      new_row(kProjector, irradiance, 4 * half_width * half_height * mean_weight(irradiance));
  if (row == nullptr) return;
  set_position(projector.to_world, row);
  set_orientation(projector.to_world, row);
  // The image is seen from behind: +x of the projector's space lies to the left.
  row[kUvScale] = static_cast<float>(-0.5 / half_width);
  row[kUvScale + 1] = static_cast<float>(-0.5 / half_height);
}

void DeltaLights::add(const scene::DirectionalEmitter& parallel, double scene_radius) {
  const double across = kPiDouble * scene_radius * scene_radius;
  float* row = new_row(kDirectional, parallel.irradiance, across * weight_of(parallel.irradiance));
  if (row == nullptr) return;
  const scene::Point& d = parallel.direction;
  const double length = std::hypot(d[0], d[1], d[2]);
  for (int k = 0; k < 3; ++k) row[kPosition + k] = static_cast<float>(-d[k] / length);
}

// Over the unit square of texture coordinates.
double DeltaLights::mean_weight(const scene::Colour& colour) const {
  const double untextured = weight_of(colour.value);
  if (colour.texture == scene::kNone || untextured == 0) return untextured;
  constexpr int kAcross = 32;
  const Spectrum value = splat(colour.value[0], colour.value[1], colour.value[2]);
  double sum = 0;
  for (int i = 0; i < kAcross * kAcross; i += kLanes) {
    geometry::SurfacePoint point{};
    const Float column = Float(_mm256_setr_ps(0.5F, 1.5F, 2.5F, 3.5F, 4.5F, 5.5F, 6.5F, 7.5F)) +
                         Float(static_cast<float>(i % kAcross));
    const int row = i / kAcross;
    point.uv = {column / Float(static_cast<float>(kAcross)),
                Float((static_cast<float>(row) + 0.5F) / kAcross)};
    point.primitive = Int(0);
    point.b1 = point.b2 = Float(0.F);
    const Spectrum texel = textures_.colour(Int(colour.texture), point, all_lanes());
    sum += sum_of_lanes(weight_of(value * texel));
  }
  return std::max(sum / (kAcross * kAcross), double(kColourShare) * untextured);
}

Vec3 DeltaLights::column3(Int light, int first, Mask lanes) const {
  const Int base = light * Int(kStride);
  const float* table = rows_.data() + first;
  return {gather(table, base, lanes), gather(table + 1, base, lanes),
          gather(table + 2, base, lanes)};
}

Vec3 DeltaLights::to_local(Int light, const Vec3& v, Mask lanes) const {
  return {dot(column3(light, kWorldToLight, lanes), v),
          dot(column3(light, kWorldToLight + 3, lanes), v),
          dot(column3(light, kWorldToLight + 6, lanes), v)};
}

LightSample DeltaLights::sample(Int light, const Vec3& reference, Mask lanes) const {
  const Vec3 position = column3(light, kPosition, lanes);
  const Vec3 to_light = position - reference;
  const Float distance2 = length_squared(to_light);
  LightSample s;
  s.distance = xsimd::sqrt(distance2);
  s.direction = to_light / s.distance;
  Spectrum strength = column3(light, kIntensity, lanes) / distance2;
  if (shaped_) {
    const Int kind = gather(kind_.data(), light, lanes);
    const Mask spot = lanes & equal(kind, Int(kSpot));
    if (any(spot))
      strength = select(spot, spot_intensity(light, -s.direction, spot) / distance2, strength);
    const Mask projector = lanes & equal(kind, Int(kProjector));
    if (any(projector)) {
      const Vec3 local = to_local(light, -to_light, projector);
      const Float cosine = local.z / s.distance;
      // E at distance 1 along the axis is what the image says: intensity E / cos^3.
      const Spectrum seen = projector_irradiance(light, local, projector);
      strength = select(projector, seen / (sqr(local.z) * cosine), strength);
    }
    const Mask parallel = lanes & equal(kind, Int(kDirectional));
    s.direction = select(parallel, position, s.direction);
    s.distance = select(parallel, Float(std::numeric_limits<float>::infinity()), s.distance);
    strength = select(parallel, column3(light, kIntensity, parallel), strength);
  }
  s.valid = lanes & not_black(strength) & (s.distance > Float(0.F));
  s.delta = s.valid;
  s.value = keep(s.valid, strength);
  return s;
}

Spectrum DeltaLights::textured(Int light, const Spectrum& value, Vec2 uv, Mask lanes) const {
  const Int texture = gather(texture_.data(), light, lanes);
  const Mask coloured = lanes & less(Int(scene::kNone), texture);
  if (none(coloured)) return value;
  geometry::SurfacePoint point{};
  point.uv = uv;
  point.primitive = Int(0);
  point.b1 = point.b2 = Float(0.F);
  return select(coloured, value * textures_.colour(texture, point, coloured), value);
}

// Intensity along `direction`, which leaves the light.
Spectrum DeltaLights::spot_intensity(Int light, const Vec3& direction, Mask lanes) const {
  const auto column = [&](int k) { return gather(rows_.data() + k, light * Int(kStride), lanes); };
  const Vec3 local = normalize(to_local(light, direction, lanes));
  const Float angle = xsimd::atan2(xsimd::sqrt(sqr(local.x) + sqr(local.y)), local.z);
  const Float slope = (column(kCutoff) - angle) * column(kPerTransition);
  const Float falloff = select(local.z >= column(kCosBeam), Float(1.F), slope);
  // Cosine and angle are rounded apart: at the very edge the slope may be below zero already.
  const Mask inside = lanes & (local.z > column(kCosCutoff)) & (falloff > Float(0.F));
  const Float scale = column(kUvScale) / local.z;
  const Vec2 uv{Float(0.5F) + local.x * scale, Float(0.5F) + local.y * scale};
  const Spectrum full = textured(light, column3(light, kIntensity, inside), uv, inside);
  return keep(inside, full * falloff);
}

// What the image shows at a point of the projector's space, 0 beside it and behind.
Spectrum DeltaLights::projector_irradiance(Int light, const Vec3& local, Mask lanes) const {
  const Int base = light * Int(kStride);
  const Vec2 uv{Float(0.5F) + gather(rows_.data() + kUvScale, base, lanes) * local.x / local.z,
                Float(0.5F) + gather(rows_.data() + kUvScale + 1, base, lanes) * local.y / local.z};
  const Float zero(0.F), one(1.F);
  const Mask inside =
      lanes & (local.z > zero) & (uv.x >= zero) & (uv.x <= one) & (uv.y >= zero) & (uv.y <= one);
  return keep(inside, textured(light, column3(light, kIntensity, inside), uv, inside));
}

uint64_t DeltaLights::bytes() const {
  return rows_.capacity() * sizeof(float) +
         (kind_.capacity() + texture_.capacity()) * sizeof(int32_t);
}

}  // namespace metrofarm::emitter
