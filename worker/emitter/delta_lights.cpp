#include "emitter/delta_lights.h"

#include <algorithm>
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

// From the light's own space, where it is at the origin and shines along +z, to that of its motion.
scene::Matrix own_place(const scene::Emitter& emitter) {
  if (const auto* spot = std::get_if<scene::SpotEmitter>(&emitter.model)) return spot->to_world;
  if (const auto* p = std::get_if<scene::ProjectorEmitter>(&emitter.model)) return p->to_world;
  if (const auto* point = std::get_if<scene::PointEmitter>(&emitter.model)) {
    const scene::Point& o = point->position;
    return {1, 0, 0, o[0], 0, 1, 0, o[1], 0, 0, 1, o[2], 0, 0, 0, 1};
  }
  const scene::Point& d = std::get<scene::DirectionalEmitter>(emitter.model).direction;
  // Any two axes beside it.
  const double length = std::hypot(d[0], d[1], d[2]);
  const scene::Point z = {d[0] / length, d[1] / length, d[2] / length};
  const double sign = std::copysign(1.0, z[2]), a = -1 / (sign + z[2]);
  const scene::Point x = {1 + sign * z[0] * z[0] * a, sign * z[0] * z[1] * a, -sign * z[0]};
  const scene::Point y = {z[0] * z[1] * a, sign + z[1] * z[1] * a, -z[1]};
  return {x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, 0, 0, 0, 1};
}

// The light as its motion has it at one time.
scene::Emitter posed(const scene::Emitter& emitter, const scene::Matrix& pose) {
  scene::Emitter out = emitter;
  const scene::Matrix m = motion::multiply(pose, own_place(emitter));
  if (auto* spot = std::get_if<scene::SpotEmitter>(&out.model)) {
    spot->to_world = m;
  } else if (auto* projector = std::get_if<scene::ProjectorEmitter>(&out.model)) {
    projector->to_world = m;
  } else if (auto* point = std::get_if<scene::PointEmitter>(&out.model)) {
    point->position = {m[3], m[7], m[11]};
  } else {
    std::get<scene::DirectionalEmitter>(out.model).direction = {m[2], m[6], m[10]};
  }
  return out;
}

// The integral of a spot's falloff over directions, sr.
double spot_solid_angle(double beam, double cutoff) {
  if (cutoff <= beam) return 2 * kPiDouble * (1 - std::cos(cutoff));
  return 2 * kPiDouble * (1 - (std::sin(cutoff) - std::sin(beam)) / (cutoff - beam));
}

}  // namespace

DeltaLights::DeltaLights(const std::vector<scene::Emitter>& emitters, const BoundingSphere& scene,
                         const motion::Interval& interval, const texture::Textures& textures)
    : textures_(textures), scene_(scene), poses_(interval) {
  for (const scene::Emitter& emitter : emitters) {
    const int before = count();
    if (emitter.motion.empty()) {
      add(emitter);
    } else {
      add(posed(emitter, motion::Track(emitter.motion).at(interval.begin)));
    }
    if (count() == before) continue;
    moving_.push_back(-1);
    if (!emitter.motion.empty()) set_in_motion(emitter);
  }
}

void DeltaLights::add(const scene::Emitter& emitter) {
  if (const auto* point = std::get_if<scene::PointEmitter>(&emitter.model)) {
    add(*point);
  } else if (const auto* spot = std::get_if<scene::SpotEmitter>(&emitter.model)) {
    add(*spot);
  } else if (const auto* projector = std::get_if<scene::ProjectorEmitter>(&emitter.model)) {
    add(*projector);
  } else if (const auto* parallel = std::get_if<scene::DirectionalEmitter>(&emitter.model)) {
    add(*parallel);
  }
}

// Of the light that was added last.
void DeltaLights::set_in_motion(const scene::Emitter& emitter) {
  const motion::Track track(emitter.motion);
  if (!track.moves_during(poses_.interval())) return;
  moving_.back() = poses_.add_viewpoint(track, own_place(emitter), scene_.radius);
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

void DeltaLights::add(const scene::DirectionalEmitter& parallel) {
  const double across = kPiDouble * scene_.radius * scene_.radius;
  float* row = new_row(kDirectional, parallel.irradiance, across * weight_of(parallel.irradiance));
  if (row == nullptr) return;
  const scene::Point& d = parallel.direction;
  const double length = std::hypot(d[0], d[1], d[2]);
  for (int k = 0; k < 3; ++k) row[kPosition + k] = static_cast<float>(-d[k] / length);
}

LightBounds DeltaLights::bounds(int light) const {
  const float* row = &rows_[size_t(light) * kStride];
  LightBounds b;
  for (int k = 0; k < 3; ++k) b.lower[k] = b.upper[k] = row[kPosition + k];
  b.normals.cosine = kAllDirections;
  b.intensity = powers_[light] / (4 * kPiDouble);
  if (moving_[light] >= 0) {
    const auto number = static_cast<size_t>(moving_[light]);
    const int segments = poses_.step_count(number) - 1;
    for (int i = 0; i <= segments; ++i) {
      const float time = static_cast<float>(i) / static_cast<float>(segments);
      const motion::Pose pose = poses_.pose(number, time);
      for (int k = 0; k < 3; ++k) {
        b.lower[k] = std::min(b.lower[k], double(pose.offset[k]));
        b.upper[k] = std::max(b.upper[k], double(pose.offset[k]));
      }
    }
    return b;
  }
  if (kind_[light] == kPoint) return b;
  // Squares of lengths in the light's space differ from those in the world where axes are scaled
  // unequally: then angles do too, and the light is taken to shine everywhere.
  Double3 axis{};
  for (int i = 0; i < 3; ++i) {
    const float* v = row + kWorldToLight + ptrdiff_t{3} * i;
    const float* next = row + kWorldToLight + ptrdiff_t{3} * ((i + 1) % 3);
    const double square = double(v[0]) * v[0] + double(v[1]) * v[1] + double(v[2]) * v[2];
    const double skew = double(v[0]) * next[0] + double(v[1]) * next[1] + double(v[2]) * next[2];
    if (std::fabs(square - 1) > 1e-4 || std::fabs(skew) > 1e-4) return b;
    for (int k = 0; k < 3; ++k) axis[k] = v[k] / std::sqrt(square);
  }
  b.normals.axis = axis;
  if (kind_[light] == kSpot) {
    const double cutoff = row[kCutoff], beam = std::acos(row[kCosBeam]);
    b.normals.cosine = std::cos(beam);
    b.cos_spread = std::cos(std::clamp(cutoff - beam, 0.0, kPiDouble));
    b.intensity = powers_[light] / spot_solid_angle(beam, cutoff);
  } else {
    const double half_width = 0.5 / std::fabs(row[kUvScale]);
    const double half_height = 0.5 / std::fabs(row[kUvScale + 1]);
    b.normals.cosine = 1 / std::hypot(1, half_width, half_height);
    b.cos_spread = 1;
    b.intensity = powers_[light] / (4 * half_width * half_height);
  }
  return b;
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

DeltaLights::Place DeltaLights::place_of(Int light, Float time, Mask lanes) const {
  Place place = {column3(light, kPosition, lanes), {splat(0.F), splat(0.F), splat(0.F)}};
  if (shaped_) {
    for (int k = 0; k < 3; ++k) place.to_light[k] = column3(light, kWorldToLight + 3 * k, lanes);
  }
  if (!anything_moves()) return place;
  const Int number = gather(moving_.data(), light, lanes);
  const Mask moving = lanes & less(Int(-1), number);
  if (none(moving)) return place;
  const motion::LanePose pose = poses_.at(number, time, moving);
  const motion::LaneInverse inverse = motion::inverse_of(pose);
  // A uniform scale has no meaning for lights.
  const Float size = xsimd::cbrt(xsimd::abs(pose.determinant()));
  const Vec3 towards = select(parallel(light, moving), -normalize(pose.column[2]), pose.offset);
  place.position = select(moving, towards, place.position);
  for (int k = 0; k < 3; ++k)
    place.to_light[k] = select(moving, inverse.row[k] * size, place.to_light[k]);
  return place;
}

Mask DeltaLights::of_kind(Int light, Kind kind, Mask lanes) const {
  if (!shaped_) return kind == kPoint ? lanes : no_lanes();
  return lanes & equal(gather(kind_.data(), light, lanes), Int(static_cast<int32_t>(kind)));
}

Mask DeltaLights::parallel(Int light, Mask lanes) const {
  return of_kind(light, kDirectional, lanes);
}

// Along `direction` (unit, away from the light); of parallel light the irradiance.
Spectrum DeltaLights::intensity(Int light, const Place& place, const Vec3& direction,
                                Mask lanes) const {
  Spectrum result = column3(light, kIntensity, lanes);
  const Mask spot = of_kind(light, kSpot, lanes);
  if (any(spot))
    result = select(spot, spot_intensity(light, place.to_local(direction), spot), result);
  const Mask projector = of_kind(light, kProjector, lanes);
  if (any(projector)) {
    const Vec3 local = place.to_local(direction);
    // E at distance 1 along the axis is what the image says: intensity E / cos^3.
    const Spectrum seen = projector_irradiance(light, local, projector);
    result = select(projector, seen / (sqr(local.z) * local.z), result);
  }
  return result;
}

LightSample DeltaLights::sample(Int light, const Receiver& receiver, Mask lanes) const {
  const Place place = place_of(light, receiver.time, lanes);
  const Vec3& position = place.position;
  const Vec3 to_light = position - receiver.position;
  const Float distance2 = length_squared(to_light);
  LightSample s;
  s.distance = xsimd::sqrt(distance2);
  s.direction = to_light / s.distance;
  Spectrum strength = intensity(light, place, -s.direction, lanes);
  const Mask far = parallel(light, lanes);
  strength = select(far, strength, strength / distance2);
  s.direction = select(far, position, s.direction);
  s.distance = select(far, Float(std::numeric_limits<float>::infinity()), s.distance);
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

// Intensity along a direction of the light's space, which leaves the light.
Spectrum DeltaLights::spot_intensity(Int light, const Vec3& leaving, Mask lanes) const {
  const auto column = [&](int k) { return gather(rows_.data() + k, light * Int(kStride), lanes); };
  const Vec3 local = normalize(leaving);
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

// The inverse of to_local().
Vec3 DeltaLights::Place::to_world(const Vec3& local) const {
  const auto& [x, y, z] = to_light;
  const Vec3 across = cross(x, y);
  const Float volume = dot(across, z);
  return (cross(y, z) * local.x + cross(z, x) * local.y + across * local.z) / volume;
}

// Uniform over the sphere, a spot's cone or a projector's image.
Vec3 DeltaLights::sample_direction(Int light, const Place& place, Vec2 u, Mask lanes) const {
  Vec3 direction = square_to_sphere(u);
  if (!shaped_) return direction;
  const Int base = light * Int(kStride);
  const auto column = [&](int k) { return gather(rows_.data() + k, base, lanes); };
  const Mask spot = of_kind(light, kSpot, lanes);
  const Vec3 in_cone = square_to_cone(u, Float(1.F) - column(kCosCutoff));
  const Vec3 on_image = {(u.x - Float(0.5F)) / column(kUvScale),
                         (u.y - Float(0.5F)) / column(kUvScale + 1), Float(1.F)};
  const Mask turned = spot | of_kind(light, kProjector, lanes);
  const Vec3 local = select(spot, in_cone, on_image);
  direction = select(turned, normalize(place.to_world(local)), direction);
  return select(parallel(light, lanes), -place.position, direction);
}

Float DeltaLights::pdf_emission(Int light, const Vec3& direction, Float time, Mask lanes) const {
  return pdf_emission(light, place_of(light, time, lanes), direction, lanes);
}

Float DeltaLights::pdf_emission(Int light, const Place& place, const Vec3& direction,
                                Mask lanes) const {
  const Float everywhere(0.25F * kInvPi);
  if (!shaped_) return everywhere;
  const Int base = light * Int(kStride);
  const auto column = [&](int k) { return gather(rows_.data() + k, base, lanes); };
  const Vec3 local = place.to_local(direction);
  const Float stretch = length(local);
  const Float cosine = local.z / stretch;
  const Float cone = select(cosine > column(kCosCutoff),
                            Float(0.5F * kInvPi) / (Float(1.F) - column(kCosCutoff)), Float(0.F));
  // Of the image plane at distance 1, whose area is the product of 1 / scale.
  const Float image = xsimd::abs(column(kUvScale) * column(kUvScale + 1)) / (sqr(cosine) * cosine);
  const Mask spot = of_kind(light, kSpot, lanes), projector = of_kind(light, kProjector, lanes);
  // A map that is more than a turn squeezes directions: by its determinant over the cubed stretch.
  Float pdf = select(spot, cone, image) / (sqr(stretch) * stretch);
  pdf = select(projector & (local.z <= Float(0.F)), Float(0.F), pdf);
  pdf = select(spot | projector, pdf, everywhere);
  return select(parallel(light, lanes), Float(1.F / scene_.disk_area()), pdf);
}

Emission DeltaLights::emit(Int light, Vec2 position, Vec2 direction, Float time, Mask lanes) const {
  const Place place = place_of(light, time, lanes);
  Emission e;
  e.direction = sample_direction(light, place, direction, lanes);
  e.origin = place.position;
  const Mask far = parallel(light, lanes);
  if (any(far)) e.origin = select(far, scene_.point_before(e.direction, position), e.origin);
  e.position = e.origin;
  e.pdf = pdf_emission(light, place, e.direction, lanes);
  const Spectrum strength = intensity(light, place, e.direction, lanes);
  e.valid = lanes & (e.pdf > Float(0.F)) & not_black(strength);
  e.power = keep(e.valid, strength / e.pdf);
  e.delta = e.valid;
  return e;
}

uint64_t DeltaLights::bytes() const {
  return rows_.capacity() * sizeof(float) +
         (kind_.capacity() + texture_.capacity() + moving_.capacity()) * sizeof(int32_t) +
         poses_.bytes();
}

}  // namespace metrofarm::emitter
