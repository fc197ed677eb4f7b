#include "geometry/surface.h"

namespace metrofarm::geometry {
namespace {

struct TriangleVertices {
  Int i0, i1, i2;
  Vec3 a, b, c;
};

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
Vec3 shading_normal_of(const Primitives& p, const TriangleVertices& t, const RayHits& hits,
                       Mask smooth, const Vec3& face_normal) {
  if (none(smooth)) return face_normal;
  const Vec3 n0 = gather3(p.normals.data(), t.i0, smooth);
  const Vec3 n1 = gather3(p.normals.data(), t.i1, smooth);
  const Vec3 n2 = gather3(p.normals.data(), t.i2, smooth);
  const Vec3 n = n0 * (Float(1.F) - hits.u - hits.v) + n1 * hits.u + n2 * hits.v;
  const Float length2 = length_squared(n);
  // Opposite vertex normals can cancel; such a point is shaded flat.
  const Mask usable = smooth & (length2 > Float(0.F));
  return select(usable, n / xsimd::sqrt(length2), face_normal);
}

// dp/du of the mesh's parameterization; an edge where it has none.
Vec3 tangent_of(const Primitives& p, const TriangleVertices& t, Mask lanes) {
  const Vec3 edge1 = t.b - t.a;
  const Vec3 edge2 = t.c - t.a;
  if (p.texcoords.empty()) return edge1;
  const auto texcoord = [&](Int vertex, int k) {
    return gather(p.texcoords.data() + k, vertex + vertex, lanes);
  };
  const Float u0 = texcoord(t.i0, 0), v0 = texcoord(t.i0, 1);
  const Float du1 = texcoord(t.i1, 0) - u0, du2 = texcoord(t.i2, 0) - u0;
  const Float dv1 = texcoord(t.i1, 1) - v0, dv2 = texcoord(t.i2, 1) - v0;
  const Float determinant = du1 * dv2 - dv1 * du2;
  const Vec3 dp_du = (edge1 * dv2 - edge2 * dv1) / determinant;
  return select(determinant != Float(0.F), dp_du, edge1);
}

void fill_triangles(const Primitives& p, const RayHits& hits, bool wants_tangent, Mask lanes,
                    Surface& s) {
  const TriangleVertices t = vertices_of(p, hits.primitive, lanes);
  const Vec3 face = normalize(cross(t.b - t.a, t.c - t.a));
  const Mask smooth = p.normals.empty()
                          ? no_lanes()
                          : lanes & equal(gather(p.has_normals.data(), s.shape, lanes), Int(1));
  s.position = t.a * (Float(1.F) - hits.u - hits.v) + t.b * hits.u + t.c * hits.v;
  s.geometric_normal = face;
  s.shading_normal = shading_normal_of(p, t, hits, smooth, face);
  s.offset = offset_of(t);
  if (wants_tangent) s.tangent = tangent_of(p, t, lanes);
}

struct AnalyticSurface {
  Vec3 position, normal, tangent;
  Float offset;
};

AnalyticSurface analytic_at(const Primitives& p, const RayHits& hits, const Vec3& origin,
                            const Vec3& direction, Mask lanes) {
  const Int index = hits.primitive - Int(p.triangle_count);
  const Int base = index * Int(kAnalyticStride);
  const auto column = [&](int k) { return gather(p.analytic.data() + k, base, lanes); };
  const Vec3 center{column(0), column(1), column(2)};
  const Mask disk = equal(gather(p.analytic_kind.data(), index, lanes),
                          Int(static_cast<int32_t>(AnalyticKind::kDisk)));
  const Vec3 along = origin + direction * hits.t;
  // Back onto the sphere: the ray's end carries an error that grows with its length.
  const Float radius = column(3);
  const Vec3 radial = normalize(along - center);
  const Vec3 axis_u{column(3), column(4), column(5)};
  const Vec3 axis_v{column(6), column(7), column(8)};
  AnalyticSurface s;
  s.normal = select(disk, normalize(cross(axis_u, axis_v)), radial);
  const Vec3 on_plane = along - s.normal * dot(along - center, s.normal);
  s.position = select(disk, on_plane, center + radial * radius);
  s.tangent = select(disk, axis_u, Vec3{-radial.y, radial.x, Float(0.F)});
  const Float extent =
      select(disk, max_component(abs(axis_u)) + max_component(abs(axis_v)), radius);
  s.offset = (max_component(abs(center)) + extent) * Float(kOffsetScale);
  return s;
}

}  // namespace

Surface surface_at(const Primitives& p, const RayHits& hits, const Vec3& origin,
                   const Vec3& direction, bool wants_tangent) {
  Surface s;
  s.shape = gather(p.shape_of.data(), hits.primitive, hits.hit);
  s.tangent = splat(0.F);
  const Mask triangles =
      hits.hit & as_mask(_mm256_cmpgt_epi32(_mm256_set1_epi32(p.triangle_count), hits.primitive));
  const Mask analytic = hits.hit & ~triangles;
  fill_triangles(p, hits, wants_tangent, triangles, s);
  if (any(analytic)) {
    const AnalyticSurface a = analytic_at(p, hits, origin, direction, analytic);
    s.position = select(analytic, a.position, s.position);
    s.geometric_normal = select(analytic, a.normal, s.geometric_normal);
    s.shading_normal = select(analytic, a.normal, s.shading_normal);
    s.tangent = select(analytic, a.tangent, s.tangent);
    s.offset = select(analytic, a.offset, s.offset);
  }
  const Float sign = gather(p.normal_sign.data(), s.shape, hits.hit);
  s.geometric_normal = s.geometric_normal * sign;
  s.shading_normal = s.shading_normal * sign;
  return s;
}

TrianglePoint point_on_triangle(const Primitives& p, Int triangle, Float b1, Float b2, Mask lanes) {
  const TriangleVertices t = vertices_of(p, triangle, lanes);
  return {t.a * (Float(1.F) - b1 - b2) + t.b * b1 + t.c * b2,
          normalize(cross(t.b - t.a, t.c - t.a)), offset_of(t)};
}

}  // namespace metrofarm::geometry
