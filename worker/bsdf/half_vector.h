// The microfacet that joins two directions by reflection or refraction.
#pragma once

#include "math/vec.h"

namespace metrofarm::bsdf {

// Walter et al. 2007, sections 4.1 and 5.2; wo and wi may lie on any side of the surface.
struct InterfaceCrossing {
  // interior: index below the surface over the index above it.
  InterfaceCrossing(const Vec3& wo, const Vec3& wi, Float interior) {
    reflect = wo.z * wi.z > Float(0.F);
    eta = select(wo.z > Float(0.F), interior, Float(1.F) / interior);
    const Vec3 half = normalize(wo + wi * select(reflect, Float(1.F), eta));
    m = half * xsimd::copysign(Float(1.F), half.z);
    const Float dot_o = dot(wo, m), dot_i = dot(wi, m);
    // The facet must be seen from the sides on which both directions are.
    compatible = (dot_o * wo.z > Float(0.F)) & (dot_i * wi.z > Float(0.F));
    cos_o = xsimd::abs(dot_o);
    cos_i = xsimd::abs(dot_i);
  }

  // Solid angle of normals per solid angle of wi, eq. 14 and 17.
  Float jacobian() const {
    return select(reflect, Float(0.25F) / cos_i, sqr(eta) * cos_i / sqr(cos_o - eta * cos_i));
  }

  Mask reflect;
  Mask compatible;
  Float eta;           // index on the far side of wo over the index on its side
  Vec3 m;              // unit, m.z > 0
  Float cos_o, cos_i;  // of the angles to m, not negative where compatible
};

}  // namespace metrofarm::bsdf
