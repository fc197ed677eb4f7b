// Maps from the unit square to the domains that renderers sample, lane by lane. Each is continuous
// wherever possible (a small step in the square is a small step in the domain) and states its pdf.
#pragma once

#include "math/vec.h"

namespace metrofarm {

inline constexpr float kPi = 3.14159265358979323846F;
inline constexpr float kInvPi = 1.F / kPi;
inline constexpr float kOneMinusEpsilon = 0x1.fffffep-1F;

struct Vec2 {
  Float x, y;
};

// sin and cos of 2 pi u for u in [0, 1): reduced to an eighth of a turn, then the minimax
// polynomials of Cephes (S. Moshier, sinf and cosf), so no libm decides the bits.
struct SinCos {
  Float sin, cos;
};
inline SinCos sincos_turn(Float u) {
  // Quadrant q holds the angles within an eighth of a turn of q quarters.
  const Float q = xsimd::floor(u * Float(4.F) + Float(0.5F));
  const Float r = (u - q * Float(0.25F)) * Float(2.F * kPi);
  const Float r2 = r * r;
  const Float s = r + r * r2 *
                          (Float(-1.6666654611e-1F) +
                           r2 * (Float(8.3321608736e-3F) + r2 * Float(-1.9515295891e-4F)));
  const Float c = Float(1.F) - Float(0.5F) * r2 +
                  r2 * r2 *
                      (Float(4.166664568298827e-2F) +
                       r2 * (Float(-1.388731625493765e-3F) + r2 * Float(2.443315711809948e-5F)));
  const Int quadrant = truncate(q);
  const Mask swap = equal(quadrant & Int(1), Int(1));
  const Mask negate_sin = equal(quadrant & Int(2), Int(2));
  const Mask negate_cos = equal((quadrant + Int(1)) & Int(2), Int(2));
  const Float sin_value = select(swap, c, s);
  const Float cos_value = select(swap, s, c);
  return {select(negate_sin, -sin_value, sin_value), select(negate_cos, -cos_value, cos_value)};
}

// Uniform on the unit disk. pdf_area = 1 / pi.
inline Vec2 square_to_disk(Vec2 u) {
  const Float r = xsimd::sqrt(u.x);
  const SinCos a = sincos_turn(u.y);
  return {r * a.cos, r * a.sin};
}

// Cosine-weighted on the upper hemisphere. pdf_solid_angle = z / pi.
inline Vec3 square_to_cosine_hemisphere(Vec2 u) {
  const Vec2 d = square_to_disk(u);
  return {d.x, d.y, safe_sqrt(Float(1.F) - u.x)};
}

// Uniform on the unit sphere. pdf_solid_angle = 1 / (4 pi).
inline Vec3 square_to_sphere(Vec2 u) {
  const Float z = Float(1.F) - Float(2.F) * u.x;
  const Float r = safe_sqrt(Float(1.F) - z * z);
  const SinCos a = sincos_turn(u.y);
  return {r * a.cos, r * a.sin, z};
}

// Uniform in the cone around +z whose half-angle has cosine 1 - one_minus_cos.
// pdf_solid_angle = 1 / (2 pi one_minus_cos). Written in 1 - cos so that narrow cones keep
// precision.
inline Vec3 square_to_cone(Vec2 u, Float one_minus_cos) {
  const Float drop = u.x * one_minus_cos;  // 1 - cos of the sampled angle
  const Float r = safe_sqrt(drop * (Float(2.F) - drop));
  const SinCos a = sincos_turn(u.y);
  return {r * a.cos, r * a.sin, Float(1.F) - drop};
}

// Barycentric coordinates (b1, b2) uniform over a triangle. pdf_area = 1 / area.
inline Vec2 square_to_triangle(Vec2 u) {
  const Float s = xsimd::sqrt(u.x);
  return {s * (Float(1.F) - u.y), s * u.y};
}

}  // namespace metrofarm
