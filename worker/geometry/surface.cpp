#include "geometry/surface.h"

#include "geometry/analytic_surface.h"

namespace metrofarm::geometry {
namespace {

struct TriangleVertices {
  Int i0, i1, i2;
  Vec3 a, b, c;
};

struct VertexNormals {
  Vec3 a, b, c;
};

// Takes the corners of meshes that deform from where they are at the time, and if there are any the
// normals too.
void deform(const Placements& placements, Int shape, Float time, Mask deforming,
            TriangleVertices& t, VertexNormals* normals) {
  const Int corner[3] = {t.i0, t.i1, t.i2};
  const DeformedCorners now =
      placements.deformations().at(shape, corner, time, normals != nullptr, deforming);
  t.a = select(deforming, now.position[0], t.a);
  t.b = select(deforming, now.position[1], t.b);
  t.c = select(deforming, now.position[2], t.c);
  if (normals == nullptr) return;
  normals->a = select(deforming, now.normal[0], normals->a);
  normals->b = select(deforming, now.normal[1], normals->b);
  normals->c = select(deforming, now.normal[2], normals->c);
}

TriangleVertices vertices_of(const Primitives& p, Int triangle, Mask lanes) {
  const Int base = triangle * Int(3);
  TriangleVertices t;
  t.i0 = gather(p.indices.data(), base, lanes);
  t.i1 = gather(p.indices.data() + 1, base, lanes);
  t.i2 = gather(p.indices.data() + 2, base, lanes);
  t.a = gather3(p.positions.data(), t.i0, lanes);
  t.b = gather3(p.positions.data(), t.i1, lanes);
  t.c = gather3(p.positions.data(), t.i2, lanes);
  return t;
}

Float offset_of(const TriangleVertices& t) {
  const Float reach = xsimd::max(max_component(abs(t.a)),
                                 xsimd::max(max_component(abs(t.b)), max_component(abs(t.c))));
  return reach * Float(kOffsetScale);
}

// Interpolated vertex normals where the mesh has them, the face's elsewhere.
Vec3 shading_normal_of(const VertexNormals& normals, const RayHits& hits, Mask smooth,
                       const Vec3& face_normal) {
  if (none(smooth)) return face_normal;
  const auto& [n0, n1, n2] = normals;
  const Vec3 n = n0 * (Float(1.F) - hits.u - hits.v) + n1 * hits.u + n2 * hits.v;
  const Float length2 = length_squared(n);
  // Opposite vertex normals can cancel; such a point is shaded flat.
  const Mask usable = smooth & (length2 > Float(0.F));
  return select(usable, n / xsimd::sqrt(length2), face_normal);
}

// table[2 * index + 0..1] per lane; (0, 0) outside m. Pairs are loaded whole, which takes about
// half the time of two gathers.
Vec2 gather2(const float* table, Int index, Mask m) {
  const __m256i masked = _mm256_and_si256(index, _mm256_castps_si256(m));
  alignas(32) int32_t i[kLanes];
  _mm256_store_si256(reinterpret_cast<__m256i*>(i), Int(masked) * Int(2));
  const auto pair = [&](int first, int second) {
    const __m128 low =
        _mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(table + i[first])));
    return _mm_loadh_pi(low, reinterpret_cast<const __m64*>(table + i[second]));
  };
  const __m256 a = _mm256_insertf128_ps(_mm256_castps128_ps256(pair(0, 1)), pair(4, 5), 1);
  const __m256 b = _mm256_insertf128_ps(_mm256_castps128_ps256(pair(2, 3)), pair(6, 7), 1);
  return {keep(m, _mm256_shuffle_ps(a, b, 0x88)), keep(m, _mm256_shuffle_ps(a, b, 0xdd))};
}

// Texture coordinates of a triangle's vertices; those of meshes without any are its barycentric
// coordinates.
struct TriangleTexcoords {
  Vec2 a, b, c;
};

TriangleTexcoords texcoords_of(const Primitives& p, const TriangleVertices& t, Int shape,
                               Mask lanes) {
  const Float zero(0.F), one(1.F);
  const TriangleTexcoords barycentric = {{zero, zero}, {one, zero}, {zero, one}};
  if (p.texcoords.empty()) return barycentric;
  const Mask own = lanes & equal(gather(p.has_texcoords.data(), shape, lanes), Int(1));
  const auto at = [&](Int vertex, const Vec2& otherwise) {
    const Vec2 uv = gather2(p.texcoords.data(), vertex, own);
    return Vec2{select(own, uv.x, otherwise.x), select(own, uv.y, otherwise.y)};
  };
  return {at(t.i0, barycentric.a), at(t.i1, barycentric.b), at(t.i2, barycentric.c)};
}

// Derivatives of the plane that the triangle's texture coordinates span; where they span none, a
// frame around its normal.
void fill_derivatives(const TriangleVertices& t, const TriangleTexcoords& uv, const Vec3& face,
                      Surface& s) {
  const Vec3 edge1 = t.b - t.a, edge2 = t.c - t.a;
  const Float du1 = uv.b.x - uv.a.x, du2 = uv.c.x - uv.a.x;
  const Float dv1 = uv.b.y - uv.a.y, dv2 = uv.c.y - uv.a.y;
  const Float determinant = du1 * dv2 - dv1 * du2;
  const Mask regular = determinant != Float(0.F);
  s.dp_du = (edge1 * dv2 - edge2 * dv1) / determinant;
  s.dp_dv = (edge2 * du1 - edge1 * du2) / determinant;
  if (all(regular)) return;
  const Frame frame = frame_around(face);
  s.dp_du = select(regular, s.dp_du, frame.s);
  s.dp_dv = select(regular, s.dp_dv, frame.t);
}

void fill_triangles(const Primitives& p, const Placements& placements, const RayHits& hits,
                    SurfaceNeeds needs, Mask lanes, Surface& s) {
  TriangleVertices t = vertices_of(p, hits.primitive, lanes);
  const Mask smooth = p.normals.empty()
                          ? no_lanes()
                          : lanes & equal(gather(p.has_normals.data(), s.shape, lanes), Int(1));
  VertexNormals normals;
  if (any(smooth)) {
    normals = {gather3(p.normals.data(), t.i0, smooth), gather3(p.normals.data(), t.i1, smooth),
               gather3(p.normals.data(), t.i2, smooth)};
  }
  const Mask deforming = placements.deformations().deforming(s.shape, lanes);
  if (any(deforming)) deform(placements, s.shape, hits.time, deforming, t, &normals);
  const Vec3 face = normalize(cross(t.b - t.a, t.c - t.a));
  const Float b0 = Float(1.F) - hits.u - hits.v;
  s.position = t.a * b0 + t.b * hits.u + t.c * hits.v;
  s.geometric_normal = face;
  s.shading_normal = shading_normal_of(normals, hits, smooth, face);
  s.offset = offset_of(t);
  if (!needs.uv && !needs.tangents) return;
  const TriangleTexcoords uv = texcoords_of(p, t, s.shape, lanes);
  s.point.uv = {uv.a.x * b0 + uv.b.x * hits.u + uv.c.x * hits.v,
                uv.a.y * b0 + uv.b.y * hits.u + uv.c.y * hits.v};
  if (needs.tangents) fill_derivatives(t, uv, face, s);
}

// Carries surfaces from their groups' space to the world.
void place_surface(const Carrier& c, SurfaceNeeds needs, Mask lanes, Surface& s) {
  const auto normal = [&](const Vec3& n) {
    return select(lanes, normalize(c.inverse.normal(n)), n);
  };
  s.position = select(lanes, c.pose.point(s.position), s.position);
  s.geometric_normal = normal(s.geometric_normal);
  s.shading_normal = normal(s.shading_normal);
  s.offset = select(lanes, s.offset * c.offset_factor + c.offset_shift, s.offset);
  if (!needs.tangents) return;
  s.dp_du = select(lanes, c.pose.vector(s.dp_du), s.dp_du);
  s.dp_dv = select(lanes, c.pose.vector(s.dp_dv), s.dp_dv);
}

// Where rays end, in the space of the primitive that they meet.
Vec3 local_end(const Carrier& c, const RayHits& hits, const Vec3& origin, const Vec3& direction,
               Mask instanced) {
  const Vec3 end = origin + direction * hits.t;
  if (none(instanced)) return end;
  const Vec3 local =
      c.inverse.vector(origin - c.pose.offset) + c.inverse.vector(direction) * hits.t;
  return select(instanced, local, end);
}

}  // namespace

Surface surface_at(const Primitives& p, const Placements& placements, const RayHits& hits,
                   const Vec3& origin, const Vec3& direction, SurfaceNeeds needs) {
  Surface s;
  s.shape = gather(p.shape_of.data(), hits.primitive, hits.hit);
  const Mask triangles = hits.hit & less(hits.primitive, Int(p.triangle_count));
  const Mask analytic = hits.hit & ~triangles;
  const Mask instanced = placements.empty() ? no_lanes() : hits.hit & less(Int(-1), hits.instance);
  Carrier carrier;
  if (any(instanced)) carrier = placements.at(hits.instance, hits.time, instanced);
  fill_triangles(p, placements, hits, needs, triangles, s);
  s.point.primitive = hits.primitive;
  s.point.b1 = hits.u;
  s.point.b2 = hits.v;
  if (any(analytic)) {
    fill_analytic(p, hits, local_end(carrier, hits, origin, direction, analytic & instanced), needs,
                  analytic, s);
  }
  const Float sign = gather(p.normal_sign.data(), s.shape, hits.hit);
  s.geometric_normal = s.geometric_normal * sign;
  s.shading_normal = s.shading_normal * sign;
  if (any(instanced)) place_surface(carrier, needs, instanced, s);
  return s;
}

TrianglePoint point_on_triangle(const Primitives& p, const Placements& placements, Int triangle,
                                Vec2 barycentric, Float time, Mask lanes, Float* area) {
  TriangleVertices t = vertices_of(p, triangle, lanes);
  if (!placements.deformations().empty()) {
    const Int shape = gather(p.shape_of.data(), triangle, lanes);
    const Mask deforming = placements.deformations().deforming(shape, lanes);
    if (any(deforming)) deform(placements, shape, time, deforming, t, nullptr);
  }
  const auto [b1, b2] = barycentric;
  const Vec3 across = cross(t.b - t.a, t.c - t.a);
  if (area != nullptr) *area = Float(0.5F) * length(across);
  return {t.a * (Float(1.F) - b1 - b2) + t.b * b1 + t.c * b2, normalize(across), offset_of(t)};
}

}  // namespace metrofarm::geometry
