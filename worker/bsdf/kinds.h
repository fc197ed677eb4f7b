// The closed set of scattering models.
#pragma once

#include "bsdf/lobes_conductor.h"
#include "bsdf/lobes_dielectric.h"
#include "bsdf/lobes_diffuse.h"
#include "bsdf/lobes_phong.h"
#include "bsdf/lobes_plastic.h"
#include "bsdf/lobes_principled.h"
#include "bsdf/microfacet.h"

namespace metrofarm::bsdf {

enum LobeKind : int32_t {
  kBlack = -1,
  kDiffuse,
  kConductor,
  kRoughConductorBeckmann,
  kRoughConductorGgx,
  kDielectric,
  kThinDielectric,
  kRoughDielectricBeckmann,
  kRoughDielectricGgx,
  kPlastic,
  kRoughPlasticBeckmann,
  kRoughPlasticGgx,
  kPhong,
  kPrincipled,
  kPrincipledThin,
  kDiffuseTransmitter,
  kNull,
  kLobeKinds
};

constexpr uint32_t kind_bit(int kind) {
  return 1U << kind;
}

// Models without any density.
inline constexpr uint32_t kDeltaKinds =
    kind_bit(kConductor) | kind_bit(kDielectric) | kind_bit(kThinDielectric) | kind_bit(kNull);

// Models that answer to directions on both sides of the surface in one frame; the others are black
// from behind.
inline constexpr uint32_t kThroughKinds =
    kind_bit(kDielectric) | kind_bit(kThinDielectric) | kind_bit(kRoughDielectricBeckmann) |
    kind_bit(kRoughDielectricGgx) | kind_bit(kPrincipled) | kind_bit(kPrincipledThin) |
    kind_bit(kDiffuseTransmitter) | kind_bit(kNull);

// Calls visit(model, lanes) for each kind in `kinds` that some lane of `lanes` shows.
template <class Visit>
void for_each_kind(uint32_t kinds, Int kind, Mask lanes, Visit&& visit) {
  const auto run = [&]<class Model>(LobeKind k, Model model) {
    if ((kinds & kind_bit(k)) == 0) return;
    const Mask here = lanes & equal(kind, Int(k));
    if (any(here)) visit(model, here);
  };
  run(kDiffuse, DiffuseLobe{});
  run(kConductor, ConductorLobe{});
  run(kRoughConductorBeckmann, RoughConductorLobe<Beckmann>{});
  run(kRoughConductorGgx, RoughConductorLobe<Ggx>{});
  run(kDielectric, DielectricLobe{});
  run(kThinDielectric, ThinDielectricLobe{});
  run(kRoughDielectricBeckmann, RoughDielectricLobe<Beckmann>{});
  run(kRoughDielectricGgx, RoughDielectricLobe<Ggx>{});
  run(kPlastic, PlasticLobe{});
  run(kRoughPlasticBeckmann, RoughPlasticLobe<Beckmann>{});
  run(kRoughPlasticGgx, RoughPlasticLobe<Ggx>{});
  run(kPhong, PhongLobe{});
  run(kPrincipled, PrincipledLobe{});
  run(kPrincipledThin, PrincipledThinLobe{});
  run(kDiffuseTransmitter, DiffuseTransmitterLobe{});
  run(kNull, NullLobe{});
}

}  // namespace metrofarm::bsdf
