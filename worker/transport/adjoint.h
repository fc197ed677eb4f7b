// Shading normals seen from the light: with them, scattering is not symmetric any more, and a path
// that is built from the light needs a factor to agree with one that is built from the eye.
#pragma once

#include "math/vec.h"

namespace metrofarm::transport {

// Factor on a bsdf evaluated along a path that comes from the light (Veach 1997, eq. 5.19): the
// cosines that the eye's side would have used, over those that the light's side has.
// Directions are unit, away from the surface: previous towards the light, next towards the eye.
// Zero lanes of `next` or `previous` in the surface give no finite factor; such directions have no
// density.
inline Float adjoint_factor(const Vec3& geometric_normal, const Vec3& shading_normal,
                            const Vec3& previous, const Vec3& next) {
  const Float wanted = dot(previous, shading_normal) * dot(next, geometric_normal);
  const Float given = dot(previous, geometric_normal) * dot(next, shading_normal);
  return xsimd::abs(wanted / given);
}

}  // namespace metrofarm::transport
