#include "emitter/area_lights.h"

#include <numbers>

#include "emitter/light_weight.h"

namespace metrofarm::emitter {

using geometry::AnalyticKind;
using geometry::kAnalyticStride;
using geometry::Surface;

namespace {

Mask negative(Int i) {
  return as_mask(_mm256_cmpgt_epi32(_mm256_setzero_si256(), i));
}

// Points of the unit square, 8 x 8, in sets of eight.
Vec2 grid_point(int row) {
  const Float column = Float(_mm256_setr_ps(0.5F, 1.5F, 2.5F, 3.5F, 4.5F, 5.5F, 6.5F, 7.5F));
  return {Float((static_cast<float>(row) + 0.5F) / 8), column / Float(8.F)};
}

}  // namespace

AreaLights::AreaLights(const scene::SceneDescription& description,
                       const geometry::Primitives& primitives,
                       const geometry::Placements& placements, const texture::Textures& textures)
    : primitives_(primitives), placements_(placements), textures_(textures) {
  const size_t shapes = primitives.shapes.size();
  radiance_.assign(3 * shapes + geometry::kSpareFloats, 0.F);
  texture_.assign(shapes, scene::kNone);
  first_light_.assign(shapes, scene::kNone);
  for (size_t s = 0; s < shapes; ++s) add_shape(description, s);
}

void AreaLights::add_shape(const scene::SceneDescription& description, size_t s) {
  const scene::Index emitter = description.shapes[s].area_emitter;
  if (emitter == scene::kNone) return;
  const scene::Colour& colour =
      std::get<scene::AreaEmitter>(description.emitters[emitter].model).radiance;
  const double weight = weight_of(colour.value);
  if (weight == 0) return;
  for (int k = 0; k < 3; ++k) radiance_[3 * s + k] = colour.value[k];
  texture_[s] = colour.texture;
  first_light_[s] = count();
  textured_ = textured_ || colour.texture != scene::kNone;
  smooth_ = smooth_ || primitives_.has_normals[s] != 0;
  const geometry::ShapeRecord& record = primitives_.shapes[s];
  const geometry::DeformingMesh* deforming = deforming_mesh(s);
  for (uint32_t p = record.first_primitive; p < record.first_primitive + record.primitive_count;
       ++p) {
    // What deforms may begin as nothing.
    const double area = deforming
                            ? geometry::largest_area_of(*deforming, p - record.first_primitive)
                            : geometry::area_of(primitives_, p);
    const bool usable = area > 0 && std::isfinite(area);
    primitive_.push_back(static_cast<int32_t>(p));
    shape_.push_back(static_cast<int32_t>(s));
    const int32_t instance = primitives_.instance_of_shape[s];
    instance_.push_back(instance);
    keeps_angles_.push_back(
        instance == scene::kNone || placements_.keeps_angles(static_cast<size_t>(instance)) ? 1
                                                                                            : 0);
    has_placed_ = has_placed_ || instance != scene::kNone;
    pdf_area_.push_back(usable ? static_cast<float>(1 / area) : 0.F);
    has_analytic_ = has_analytic_ || primitive_.back() >= primitives_.triangle_count;
    const double mean = colour.texture == scene::kNone ? weight : mean_weight(count() - 1, colour);
    powers_.push_back(usable ? std::numbers::pi * area * mean * mean_stretch(count() - 1) : 0.0);
  }
}

const geometry::DeformingMesh* AreaLights::deforming_mesh(size_t shape) const {
  for (const geometry::DeformingMesh& mesh : primitives_.deforming)
    if (static_cast<size_t>(mesh.shape) == shape) return &mesh;
  return nullptr;
}

// Mean over the light's surface. Points may miss the little that is bright, which is chosen now
// and then all the same.
double AreaLights::mean_weight(int light, const scene::Colour& colour) const {
  const Int lights(light);
  const Int shape(shape_[light]);
  const uint32_t siblings = primitives_.shapes[shape_[light]].primitive_count;
  const int step = siblings > 256 ? 4 : 1;  // 16 points each, or 64
  double sum = 0;
  int rows = 0;
  for (int row = step / 2; row < 8; row += step, ++rows) {
    const Point point = uniform_point(lights, grid_point(row), Float(0.F), all_lanes());
    const Surface surface = surface_of(lights, point, Float(0.F), all_lanes());
    sum += sum_of_lanes(weight_of(radiance(shape, surface.point, all_lanes())));
  }
  return std::max(sum / (kLanes * rows), double(kColourShare) * weight_of(colour.value));
}

// At its middle, over eight times. What has no area at all these times may have one at others: it
// must be chosen now and then.
double AreaLights::mean_stretch(int light) const {
  if (instance_[light] == scene::kNone) return 1;
  const Int lights(light);
  const Float times = Float(_mm256_setr_ps(0.5F, 1.5F, 2.5F, 3.5F, 4.5F, 5.5F, 6.5F, 7.5F));
  const Float time = times / Float(8.F);
  Point point = uniform_point(lights, {Float(0.5F), Float(0.5F)}, time, all_lanes());
  place(placed(lights, time, all_lanes()), point);
  constexpr double kSeldom = 1.0 / 64;
  const double mean = sum_of_lanes(point.stretch) / kLanes;
  return mean > 0 ? mean : kSeldom;
}

AreaLights::Placed AreaLights::placed(Int light, Float time, Mask lanes) const {
  Placed p;
  if (!has_placed_) return p;
  const Int instance = gather(instance_.data(), light, lanes);
  p.lanes = lanes & ~negative(instance);
  if (none(p.lanes)) return p;
  p.keeps_angles = equal(gather(keeps_angles_.data(), light, lanes), Int(1));
  p.carrier = placements_.at(instance, time, p.lanes);
  return p;
}

// From the light's space to the world.
void AreaLights::place(const Placed& placed, Point& point) {
  if (none(placed.lanes)) return;
  const geometry::Carrier& c = placed.carrier;
  const Vec3 normal = c.inverse.normal(point.normal);
  const Float length_of_normal = length(normal);
  point.position = select(placed.lanes, c.pose.point(point.position), point.position);
  point.normal = select(placed.lanes, normal / length_of_normal, point.normal);
  point.offset =
      select(placed.lanes, point.offset * c.offset_factor + c.offset_shift, point.offset);
  const Float stretch = xsimd::abs(c.pose.determinant()) * length_of_normal;
  point.stretch = select(placed.lanes, point.stretch * stretch, point.stretch);
}

// The area in the light's own space, as a share of the largest that it has while deforming.
Float AreaLights::own_stretch(Int light, Float time, Mask lanes) const {
  const Int shape = gather(shape_.data(), light, lanes);
  const Mask deforming = placements_.deformations().deforming(shape, lanes);
  if (none(deforming)) return Float(1.F);
  Float area;
  geometry::point_on_triangle(primitives_, placements_, gather(primitive_.data(), light, deforming),
                              {Float(0.F), Float(0.F)}, time, deforming, &area);
  return select(deforming, area * gather(pdf_area_.data(), light, deforming), Float(1.F));
}

Float AreaLights::stretch(Int light, const Vec3& normal, Float time, Mask lanes) const {
  const Placed p = placed(light, time, lanes);
  if (none(p.lanes)) return Float(1.F);
  // The normal in the light's space is that of the world under the transpose of the pose.
  const auto& column = p.carrier.pose.column;
  const Vec3 local = {dot(column[0], normal), dot(column[1], normal), dot(column[2], normal)};
  const Float carried = xsimd::abs(p.carrier.pose.determinant()) / length(local);
  return own_stretch(light, time, lanes) * select(p.lanes, carried, Float(1.F));
}

Mask AreaLights::analytic(Int light, Mask lanes) const {
  if (!has_analytic_) return no_lanes();
  const Int primitive = gather(primitive_.data(), light, lanes);
  return lanes & ~negative(primitive - Int(primitives_.triangle_count));
}

Mask AreaLights::of_kind(Int light, AnalyticKind kind, Mask analytic_lanes) const {
  if (none(analytic_lanes)) return analytic_lanes;
  const Int row =
      gather(primitive_.data(), light, analytic_lanes) - Int(primitives_.triangle_count);
  return analytic_lanes & equal(gather(primitives_.analytic_kind.data(), row, analytic_lanes),
                                Int(static_cast<int32_t>(kind)));
}

// Three numbers of an analytic shape's row.
Vec3 AreaLights::column3(Int light, int first, Mask lanes) const {
  const Int row = gather(primitive_.data(), light, lanes) - Int(primitives_.triangle_count);
  const Int base = row * Int(kAnalyticStride);
  const float* table = primitives_.analytic.data() + first;
  return {gather(table, base, lanes), gather(table + 1, base, lanes),
          gather(table + 2, base, lanes)};
}

Float AreaLights::sign_of(Int light, Mask lanes) const {
  return gather(primitives_.normal_sign.data(), gather(shape_.data(), light, lanes), lanes);
}

// pdf_area = 1 / area.
AreaLights::Point AreaLights::uniform_point(Int light, Vec2 u, Float time, Mask lanes) const {
  const Mask shaped = analytic(light, lanes);
  const Vec2 b = square_to_triangle(u);
  const geometry::TrianglePoint t = geometry::point_on_triangle(
      primitives_, placements_, gather(primitive_.data(), light, lanes), b, time, lanes & ~shaped);
  Point point{t.position, t.normal, t.offset, b.x, b.y};
  if (has_placed_) point.stretch = own_stretch(light, time, lanes);
  if (any(shaped)) {
    move_to_disk(light, u, of_kind(light, AnalyticKind::kDisk, shaped), point);
    move_to_cylinder(light, u, of_kind(light, AnalyticKind::kCylinder, shaped), point);
    move_to_sphere(light, u, of_kind(light, AnalyticKind::kSphere, shaped), point);
  }
  point.normal = point.normal * sign_of(light, lanes);
  return point;
}

void AreaLights::move_to_disk(Int light, Vec2 u, Mask disk, Point& point) const {
  if (none(disk)) return;
  const Vec2 d = square_to_disk(u);
  const Vec3 center = column3(light, 0, disk);
  const Vec3 axis_u = column3(light, 3, disk), axis_v = column3(light, 6, disk);
  const Float reach =
      max_component(abs(center)) + max_component(abs(axis_u)) + max_component(abs(axis_v));
  point.position = select(disk, center + axis_u * d.x + axis_v * d.y, point.position);
  point.normal = select(disk, normalize(cross(axis_u, axis_v)), point.normal);
  point.offset = select(disk, reach * Float(geometry::kOffsetScale), point.offset);
}

// Uniform in azimuth and height, which is uniform in area: both radii are equal.
void AreaLights::move_to_cylinder(Int light, Vec2 u, Mask cylinder, Point& point) const {
  if (none(cylinder)) return;
  const geometry::TrianglePoint on = geometry::point_on_cylinder(
      primitives_, gather(primitive_.data(), light, cylinder), u, cylinder);
  point.position = select(cylinder, on.position, point.position);
  point.normal = select(cylinder, on.normal, point.normal);
  point.offset = select(cylinder, on.offset, point.offset);
}

void AreaLights::move_to_sphere(Int light, Vec2 u, Mask sphere, Point& point) const {
  if (none(sphere)) return;
  const Vec3 center = column3(light, 0, sphere);
  const Float radius = column3(light, 3, sphere).x;
  const Vec3 outward = square_to_sphere(u);
  const Float reach = max_component(abs(center)) + radius;
  point.position = select(sphere, center + outward * radius, point.position);
  point.normal = select(sphere, outward, point.normal);
  point.offset = select(sphere, reach * Float(geometry::kOffsetScale), point.offset);
}

// Lanes whose reference lies outside the sphere, where its visible cap is sampled by solid angle.
Mask AreaLights::outside_sphere(Int light, const Vec3& reference, Mask sphere,
                                Float& one_minus_cos) const {
  const Vec3 center = column3(light, 0, sphere);
  const Float sin2 = sqr(column3(light, 3, sphere).x) / length_squared(reference - center);
  one_minus_cos = sin2 / (Float(1.F) + safe_sqrt(Float(1.F) - sin2));
  // Just above the surface the cap is nearly half the sphere and 1 - cos loses its digits to sin2.
  return sphere & (sin2 < Float(0.999F));
}

// Where the sphere is seen from outside: a direction in the cone that it fills, and the point that
// the direction meets. Elsewhere the point stays.
Mask AreaLights::move_to_cap(Int light, const Vec3& reference, Vec2 u, Mask sphere, Point& point,
                             Float& pdf_solid_angle) const {
  Float one_minus_cos;
  const Mask cone = outside_sphere(light, reference, sphere, one_minus_cos);
  if (none(cone)) return cone;
  const Vec3 center = column3(light, 0, cone);
  const Float radius = column3(light, 3, cone).x;
  const Vec3 to_center = center - reference;
  const Float distance = length(to_center);
  const Vec3 local = square_to_cone(u, one_minus_cos);
  const Vec3 direction = frame_around(to_center / distance).to_world(local);
  const Float sin2 = sqr(local.x) + sqr(local.y);
  const Float near = distance * local.z - safe_sqrt(sqr(radius) - sqr(distance) * sin2);
  const Vec3 outward = normalize(reference + direction * near - center);
  point.position = select(cone, center + outward * radius, point.position);
  point.normal = select(cone, outward * sign_of(light, cone), point.normal);
  pdf_solid_angle = Float(1.F) / (Float(2 * kPi) * one_minus_cos);
  return cone;
}

// The surface as a ray that ends at the point finds it.
Surface AreaLights::surface_of(Int light, const Point& point, Float time, Mask lanes) const {
  geometry::RayHits hits;
  hits.hit = lanes;
  hits.t = Float(0.F);
  hits.u = point.b1;
  hits.v = point.b2;
  hits.primitive = gather(primitive_.data(), light, lanes);
  hits.instance = has_placed_ ? gather(instance_.data(), light, lanes) : Int(-1);
  hits.time = time;
  return geometry::surface_at(primitives_, placements_, hits, point.position, point.normal,
                              {.uv = textured_});
}

LightSample AreaLights::sample(Int light, const Receiver& receiver, Vec2 u, Mask lanes) const {
  const Vec3& reference = receiver.position;
  Point point = uniform_point(light, u, receiver.time, lanes);
  const Placed where = placed(light, receiver.time, lanes);
  Float cap_pdf(0.F);
  const Mask sphere = sphere_of(light, where, lanes);
  const Mask cap = any(sphere)
                       ? move_to_cap(light, local(where, reference), u, sphere, point, cap_pdf)
                       : no_lanes();
  place(where, point);

  LightSample s;
  // Aim just in front of the light, so that the shadow ray does not meet the light itself.
  const Vec3 target = geometry::offset_origin(point.position, point.normal, point.offset,
                                              reference - point.position);
  const Vec3 to_light = target - reference;
  const Float distance2 = length_squared(to_light);
  s.distance = xsimd::sqrt(distance2);
  s.direction = to_light / s.distance;
  s.cosine = -dot(s.direction, point.normal);
  const Float cosine = xsimd::abs(s.cosine);

  Surface surface;
  surface.shape = gather(shape_.data(), light, lanes);
  surface.shading_normal = point.normal;
  if (smooth_ || textured_) surface = surface_of(light, point, receiver.time, lanes);
  const Spectrum radiance = emitted(surface, s.direction, lanes);
  s.valid = lanes & not_black(radiance) & (distance2 > Float(0.F)) & (cosine > Float(0.F));
  s.stretch = point.stretch;
  s.pdf_solid_angle = keep(
      s.valid, select(cap, cap_pdf, pdf_area(light, point.stretch, lanes) * distance2 / cosine));
  s.value = keep(s.valid, radiance / s.pdf_solid_angle);
  return s;
}

Emission AreaLights::emit(Int light, Vec2 position, Vec2 direction, Float time, Mask lanes) const {
  Point point = uniform_point(light, position, time, lanes);
  place(placed(light, time, lanes), point);
  Emission e;
  const Vec3 local = square_to_cosine_hemisphere(direction);
  e.direction = frame_around(point.normal).to_world(local);
  e.position = point.position;
  e.normal = point.normal;
  e.origin = geometry::offset_origin(point.position, point.normal, point.offset, e.direction);
  e.cosine = local.z;
  e.pdf = pdf_emission(light, e.cosine, point.stretch, lanes);
  Surface surface;
  surface.shape = gather(shape_.data(), light, lanes);
  surface.shading_normal = point.normal;
  if (smooth_ || textured_) surface = surface_of(light, point, time, lanes);
  const Spectrum found = emitted(surface, -e.direction, lanes);
  e.valid = lanes & (e.pdf > Float(0.F)) & not_black(found);
  e.power = keep(e.valid, found * e.cosine / e.pdf);
  return e;
}

// Spheres whose visible cap is sampled, which takes a space where angles are those of the world.
Mask AreaLights::sphere_of(Int light, const Placed& where, Mask lanes) const {
  return where.keeps_angles & of_kind(light, AnalyticKind::kSphere, analytic(light, lanes));
}

// A point of the world in the light's space.
Vec3 AreaLights::local(const Placed& where, const Vec3& point) {
  if (none(where.lanes)) return point;
  const geometry::Carrier& c = where.carrier;
  return select(where.lanes, c.inverse.vector(point - c.pose.offset), point);
}

Float AreaLights::pdf(Int light, const Receiver& receiver, const Surface& surface,
                      const Vec3& direction, Mask lanes) const {
  const Vec3& reference = receiver.position;
  const Float cosine = xsimd::abs(dot(direction, surface.geometric_normal));
  const Float distance2 = length_squared(surface.position - reference);
  const Float stretched =
      has_placed_ ? stretch(light, surface.geometric_normal, receiver.time, lanes) : Float(1.F);
  Float pdf = pdf_area(light, stretched, lanes) * distance2 / cosine;
  Mask sphere = of_kind(light, AnalyticKind::kSphere, analytic(light, lanes));
  if (any(sphere)) {
    const Placed where = placed(light, receiver.time, sphere);
    sphere = sphere_of(light, where, sphere);
    Float one_minus_cos;
    const Mask cap = outside_sphere(light, local(where, reference), sphere, one_minus_cos);
    pdf = select(cap, Float(1.F) / (Float(2 * kPi) * one_minus_cos), pdf);
  }
  return keep(lanes, pdf);
}

Mask AreaLights::radiates(Int shape, Mask lanes) const {
  return lanes & ~negative(gather(first_light_.data(), shape, lanes));
}

Int AreaLights::light_at(Int shape, Int primitive, Mask lanes) const {
  // A record is two numbers: its first primitive and their count.
  static_assert(sizeof(geometry::ShapeRecord) == 2 * sizeof(uint32_t));
  const auto* records = reinterpret_cast<const int32_t*>(primitives_.shapes.data());
  return gather(first_light_.data(), shape, lanes) + primitive -
         gather(records, shape + shape, lanes);
}

Spectrum AreaLights::radiance(Int shape, const geometry::SurfacePoint& point, Mask lanes) const {
  Spectrum value = gather3(radiance_.data(), shape, lanes);
  if (!textured_) return value;
  const Int texture = gather(texture_.data(), shape, lanes);
  const Mask coloured = lanes & not_black(value) & ~negative(texture);
  if (any(coloured))
    value = select(coloured, value * textures_.colour(texture, point, coloured), value);
  return value;
}

Spectrum AreaLights::emitted(const Surface& surface, const Vec3& direction, Mask lanes) const {
  const Mask front = lanes & (dot(direction, surface.shading_normal) < Float(0.F));
  return radiance(surface.shape, surface.point, front);
}

uint64_t AreaLights::bytes() const {
  return (pdf_area_.capacity() + radiance_.capacity()) * sizeof(float) +
         (primitive_.capacity() + shape_.capacity() + instance_.capacity() +
          keeps_angles_.capacity() + texture_.capacity() + first_light_.capacity()) *
             sizeof(int32_t);
}

}  // namespace metrofarm::emitter
