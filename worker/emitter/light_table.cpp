#include "emitter/light_table.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "base/check.h"

namespace metrofarm::emitter {
namespace {

using geometry::AnalyticKind;
using geometry::kAnalyticStride;
using scene::AreaEmitter;
using scene::ConstantEmitter;
using scene::PointEmitter;

double luminance_of(const scene::Rgb& rgb) {
  return double(kLuminanceR) * rgb[0] + double(kLuminanceG) * rgb[1] + double(kLuminanceB) * rgb[2];
}

// Below the luminance of any light that matters, but above zero: a light of pure saturated colour
// or of negligible brightness is still chosen now and then.
double weight_of(const scene::Rgb& rgb) {
  const double largest = std::max({rgb[0], rgb[1], rgb[2]});
  const double weight = std::max(luminance_of(rgb), 0.01 * largest);
  // A light whose colour is no number is kept, so that its contributions are found and counted.
  return std::isfinite(weight) && weight >= 0 ? weight : 1;
}

}  // namespace

LightTable::LightTable(const scene::SceneDescription& description,
                       const geometry::Primitives& primitives)
    : primitives_(primitives) {
  radiance_.assign(3 * primitives.shapes.size() + geometry::kSpareFloats, 0.F);
  pick_per_area_.assign(primitives.shapes.size(), 0.F);
  pick_.assign(primitives.shapes.size(), 0.F);
  add_area_lights(description);
  add_other_lights(description);
  normalize_picks();
}

void LightTable::add(Kind kind, int32_t index, double power) {
  kind_.push_back(kind);
  index_.push_back(index);
  power_.push_back(power);
}

void LightTable::add_area_lights(const scene::SceneDescription& description) {
  for (size_t s = 0; s < description.shapes.size(); ++s) {
    const scene::Index emitter = description.shapes[s].area_emitter;
    if (emitter == scene::kNone) continue;
    const auto& area = std::get<AreaEmitter>(description.emitters[emitter].model);
    const double weight = std::numbers::pi * weight_of(area.radiance);
    if (weight == 0) continue;
    for (int k = 0; k < 3; ++k) radiance_[3 * s + k] = area.radiance[k];
    pick_per_area_[s] = static_cast<float>(weight);
    const geometry::ShapeRecord& record = primitives_.shapes[s];
    for (uint32_t i = 0; i < record.primitive_count; ++i) {
      const auto primitive = static_cast<int32_t>(record.first_primitive + i);
      const int32_t analytic = primitive - primitives_.triangle_count;
      const Kind kind = analytic < 0 ? kTriangle
                        : primitives_.analytic_kind[analytic] == int32_t(AnalyticKind::kSphere)
                            ? kSphere
                            : kDisk;
      const double power = weight * geometry::area_of(primitives_, record.first_primitive + i);
      if (power > 0) add(kind, primitive, power);
    }
  }
}

double LightTable::scene_radius() const {
  double low[3], high[3];
  std::fill_n(low, 3, std::numeric_limits<double>::infinity());
  std::fill_n(high, 3, -std::numeric_limits<double>::infinity());
  const auto include = [&](const float* p, double extent) {
    for (int k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k] - extent);
      high[k] = std::max(high[k], p[k] + extent);
    }
  };
  for (size_t i = 0; i < primitives_.vertex_count; ++i) include(&primitives_.positions[3 * i], 0);
  for (size_t i = 0; i < primitives_.analytic_kind.size(); ++i) {
    const float* a = &primitives_.analytic[i * kAnalyticStride];
    const bool sphere = primitives_.analytic_kind[i] == int32_t(AnalyticKind::kSphere);
    include(a, sphere ? a[3] : std::hypot(a[3], a[4], a[5]) + std::hypot(a[6], a[7], a[8]));
  }
  if (!(high[0] >= low[0])) return 1;
  return 0.5 * std::hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
}

void LightTable::add_other_lights(const scene::SceneDescription& description) {
  for (const scene::Emitter& emitter : description.emitters) {
    if (const auto* point = std::get_if<PointEmitter>(&emitter.model)) {
      const double power = 4 * std::numbers::pi * weight_of(point->intensity);
      if (power == 0) continue;
      add(kPoint, static_cast<int32_t>(points_.size() / 6), power);
      for (double v : point->position) points_.push_back(static_cast<float>(v));
      for (float v : point->intensity) points_.push_back(v);
    } else if (const auto* constant = std::get_if<ConstantEmitter>(&emitter.model)) {
      const double radius = scene_radius();
      const double weight = weight_of(constant->radiance);
      if (weight == 0) continue;
      for (int k = 0; k < 3; ++k) environment_radiance_[k] += constant->radiance[k];
      add(kEnvironment, 0, std::numbers::pi * std::numbers::pi * radius * radius * weight);
    }
  }
}

void LightTable::normalize_picks() {
  double total = 0;
  for (double p : power_) total += p;
  if (!(total > 0)) return;
  double sum = 0;
  for (size_t i = 0; i < power_.size(); ++i) {
    const double pick = power_[i] / total;
    sum += pick;
    cdf_.push_back(static_cast<float>(sum));
    const int32_t index = index_[i];
    if (kind_[i] == kEnvironment) environment_pick_ += static_cast<float>(pick);
    if (kind_[i] == kSphere || kind_[i] == kDisk) {
      pick_[primitives_.shape_of[index]] = static_cast<float>(pick);
    }
    if (kind_[i] == kPoint) {
      for (int k = 3; k < 6; ++k) points_[6 * size_t(index) + k] /= static_cast<float>(pick);
    }
  }
  cdf_.back() = std::numeric_limits<float>::infinity();  // rounding must not leave a gap at 1
  for (float& density : pick_per_area_) density = static_cast<float>(density / total);
  power_ = {};
}

// First light whose cdf exceeds choice: a binary search that all lanes walk in step.
Int LightTable::pick(Float choice) const {
  Int low(0);
  auto span = static_cast<int32_t>(cdf_.size());
  while (span > 1) {
    const int32_t half = span / 2;
    const Float bound = gather(cdf_.data(), low + Int(half - 1), all_lanes());
    low = select(choice >= bound, low + Int(half), low);
    span -= half;
  }
  return low;
}

LightSample LightTable::sample(const Vec3& reference, Float choice, Vec2 position,
                               Mask lanes) const {
  if (cdf_.empty()) return {};
  const Int light = pick(choice);
  const Int kind = gather(kind_.data(), light, lanes);
  LightSample result;
  const auto blend = [&](Mask here, auto&& make) {
    if (none(here)) return;
    const LightSample s = make(here);
    result.direction = select(here, s.direction, result.direction);
    result.distance = select(here, s.distance, result.distance);
    result.value = select(here, s.value, result.value);
    result.pdf_solid_angle = select(here, s.pdf_solid_angle, result.pdf_solid_angle);
    result.valid = result.valid | (s.valid & here);
    result.delta = result.delta | (s.delta & here);
  };
  const Mask flat = lanes & (equal(kind, Int(kTriangle)) | equal(kind, Int(kDisk)));
  blend(flat, [&](Mask m) { return sample_area(light, reference, position, m); });
  blend(lanes & equal(kind, Int(kSphere)),
        [&](Mask m) { return sample_sphere(light, reference, position, m); });
  blend(lanes & equal(kind, Int(kPoint)),
        [&](Mask m) { return sample_point(light, reference, m); });
  blend(lanes & equal(kind, Int(kEnvironment)),
        [&](Mask m) { return sample_environment(position, m); });
  return result;
}

namespace {

// Completes a sample of a point on a surface, chosen with pdf_area.
LightSample towards(const Vec3& reference, const Vec3& position, const Vec3& normal, Float offset,
                    const Spectrum& radiance, Float pdf_area, Mask lanes) {
  LightSample s;
  // Aim just in front of the light, so that the shadow ray does not meet the light itself.
  const Vec3 target = position + normal * offset;
  const Vec3 to_light = target - reference;
  const Float distance2 = length_squared(to_light);
  s.distance = xsimd::sqrt(distance2);
  s.direction = to_light / s.distance;
  const Float cosine = -dot(s.direction, normal);
  s.valid = lanes & (cosine > Float(0.F)) & (distance2 > Float(0.F));
  s.pdf_solid_angle = keep(s.valid, pdf_area * distance2 / cosine);
  s.value = keep(s.valid, radiance / s.pdf_solid_angle);
  return s;
}

}  // namespace

LightSample LightTable::sample_area(Int light, const Vec3& reference, Vec2 u, Mask lanes) const {
  const Int primitive = gather(index_.data(), light, lanes);
  const Int shape = gather(primitives_.shape_of.data(), primitive, lanes);
  const Int analytic = primitive - Int(primitives_.triangle_count);
  const Mask disk = lanes & as_mask(_mm256_cmpgt_epi32(analytic, _mm256_set1_epi32(-1)));
  const Vec2 b = square_to_triangle(u);
  geometry::TrianglePoint point =
      geometry::point_on_triangle(primitives_, primitive, b.x, b.y, lanes & ~disk);
  if (any(disk)) {
    const Int base = analytic * Int(kAnalyticStride);
    const auto axis = [&](int first) {
      return Vec3{gather(primitives_.analytic.data() + first, base, disk),
                  gather(primitives_.analytic.data() + first + 1, base, disk),
                  gather(primitives_.analytic.data() + first + 2, base, disk)};
    };
    const Vec2 d = square_to_disk(u);
    const Vec3 center = axis(0), axis_u = axis(3), axis_v = axis(6);
    point.position = select(disk, center + axis_u * d.x + axis_v * d.y, point.position);
    point.normal = select(disk, normalize(cross(axis_u, axis_v)), point.normal);
    const Float reach =
        max_component(abs(center)) + max_component(abs(axis_u)) + max_component(abs(axis_v));
    point.offset = select(disk, reach * Float(geometry::kOffsetScale), point.offset);
  }
  const Float sign = gather(primitives_.normal_sign.data(), shape, lanes);
  return towards(reference, point.position, point.normal * sign, point.offset,
                 gather3(radiance_.data(), shape, lanes),
                 gather(pick_per_area_.data(), shape, lanes), lanes);
}

// Lanes whose reference lies outside the sphere, where its visible cap is sampled by solid angle.
Mask LightTable::outside_sphere(Int analytic, const Vec3& reference, Mask lanes,
                                Float& one_minus_cos) const {
  const Int base = analytic * Int(kAnalyticStride);
  const Vec3 center{gather(primitives_.analytic.data(), base, lanes),
                    gather(primitives_.analytic.data() + 1, base, lanes),
                    gather(primitives_.analytic.data() + 2, base, lanes)};
  const Float radius = gather(primitives_.analytic.data() + 3, base, lanes);
  const Float sin2 = sqr(radius) / length_squared(reference - center);
  // Just above the surface the cap is nearly half the sphere and 1 - cos loses its digits to sin2.
  const Mask outside = lanes & (sin2 < Float(0.999F));
  one_minus_cos = sin2 / (Float(1.F) + safe_sqrt(Float(1.F) - sin2));
  return outside;
}

LightSample LightTable::sample_sphere(Int light, const Vec3& reference, Vec2 u, Mask lanes) const {
  const Int primitive = gather(index_.data(), light, lanes);
  const Int shape = gather(primitives_.shape_of.data(), primitive, lanes);
  const Int analytic = primitive - Int(primitives_.triangle_count);
  const Int base = analytic * Int(kAnalyticStride);
  const auto column = [&](int k) { return gather(primitives_.analytic.data() + k, base, lanes); };
  const Vec3 center{column(0), column(1), column(2)};
  const Float radius = column(3);
  const Float sign = gather(primitives_.normal_sign.data(), shape, lanes);
  const Spectrum radiance = gather3(radiance_.data(), shape, lanes);
  const Float offset = (max_component(abs(center)) + radius) * Float(geometry::kOffsetScale);

  Float one_minus_cos;
  const Mask cone = outside_sphere(analytic, reference, lanes, one_minus_cos);
  // From outside: a direction in the cone that the sphere fills, and the point it meets.
  const Vec3 to_center = center - reference;
  const Float distance = length(to_center);
  const Vec3 local = square_to_cone(u, one_minus_cos);
  const Vec3 direction = frame_around(to_center / distance).to_world(local);
  const Float sin2 = sqr(local.x) + sqr(local.y);
  const Float near = distance * local.z - safe_sqrt(sqr(radius) - sqr(distance) * sin2);
  const Vec3 cone_normal = normalize(reference + direction * near - center);
  // From inside or on it: a uniform point of the whole sphere.
  const Vec3 outward = select(cone, cone_normal, square_to_sphere(u));

  LightSample s = towards(reference, center + outward * radius, outward * sign, offset, radiance,
                          gather(pick_per_area_.data(), shape, lanes), lanes);
  const Float cone_pdf = gather(pick_.data(), shape, lanes) / (Float(2 * kPi) * one_minus_cos);
  s.pdf_solid_angle = select(cone, keep(s.valid, cone_pdf), s.pdf_solid_angle);
  s.value = keep(s.valid, radiance / s.pdf_solid_angle);
  return s;
}

LightSample LightTable::sample_point(Int light, const Vec3& reference, Mask lanes) const {
  const Int base = gather(index_.data(), light, lanes) * Int(6);
  const auto column = [&](int k) { return gather(points_.data() + k, base, lanes); };
  const Vec3 to_light = Vec3{column(0), column(1), column(2)} - reference;
  const Float distance2 = length_squared(to_light);
  LightSample s;
  s.distance = xsimd::sqrt(distance2);
  s.direction = to_light / s.distance;
  s.valid = lanes & (distance2 > Float(0.F));
  s.delta = s.valid;
  s.value = keep(s.valid, Spectrum{column(3), column(4), column(5)} / distance2);
  return s;
}

LightSample LightTable::sample_environment(Vec2 u, Mask lanes) const {
  LightSample s;
  s.direction = square_to_sphere(u);
  s.distance = Float(std::numeric_limits<float>::infinity());
  s.valid = lanes;
  s.pdf_solid_angle = keep(lanes, environment_pdf());
  s.value = keep(lanes, environment() / environment_pdf());
  return s;
}

Spectrum LightTable::environment() const {
  return splat(environment_radiance_[0], environment_radiance_[1], environment_radiance_[2]);
}

Spectrum LightTable::emitted(const geometry::Surface& surface, const Vec3& direction,
                             Mask lanes) const {
  const Mask front = lanes & (dot(direction, surface.geometric_normal) < Float(0.F));
  return gather3(radiance_.data(), surface.shape, front);
}

Float LightTable::pdf_of_hit(const Vec3& reference, const geometry::RayHits& hits,
                             const geometry::Surface& surface, const Vec3& direction,
                             Mask lanes) const {
  const Float pdf_area = gather(pick_per_area_.data(), surface.shape, lanes);
  const Float cosine = xsimd::abs(dot(direction, surface.geometric_normal));
  const Float distance2 = length_squared(surface.position - reference);
  Float pdf = pdf_area * distance2 / cosine;
  const Int analytic = hits.primitive - Int(primitives_.triangle_count);
  const Mask curved = lanes & as_mask(_mm256_cmpgt_epi32(analytic, _mm256_set1_epi32(-1)));
  if (any(curved)) {
    const Mask sphere = curved & equal(gather(primitives_.analytic_kind.data(), analytic, curved),
                                       Int(int32_t(AnalyticKind::kSphere)));
    Float one_minus_cos;
    const Mask cone = outside_sphere(analytic, reference, sphere, one_minus_cos);
    const Float pick = gather(pick_.data(), surface.shape, cone);
    pdf = select(cone, pick / (Float(2 * kPi) * one_minus_cos), pdf);
  }
  return pdf;
}

uint64_t LightTable::bytes() const {
  return (cdf_.capacity() + radiance_.capacity() + pick_per_area_.capacity() + pick_.capacity() +
          points_.capacity()) *
             sizeof(float) +
         (kind_.capacity() + index_.capacity()) * sizeof(int32_t);
}

}  // namespace metrofarm::emitter
