#include "bsdf/materials.h"

#include "base/check.h"

namespace metrofarm::bsdf {
namespace {

enum LobeKind : int32_t {
  kDiffuse,
  kConductor,
  kRoughConductorBeckmann,
  kRoughConductorGgx,
  kDielectric,
  kLobeKinds
};

constexpr uint32_t kDeltaKinds = (1U << kConductor) | (1U << kDielectric);

// Calls visit(model, lanes) for each kind in `kinds` that some lane of `lanes` shows.
template <class Visit>
void for_each_kind(uint32_t kinds, Int kind, Mask lanes, Visit&& visit) {
  const auto run = [&]<class Model>(LobeKind k, Model model) {
    if ((kinds >> k & 1U) == 0) return;
    const Mask here = lanes & equal(kind, Int(k));
    if (any(here)) visit(model, here);
  };
  run(kDiffuse, DiffuseLobe{});
  run(kConductor, ConductorLobe{});
  run(kRoughConductorBeckmann, RoughConductorLobe<Beckmann>{});
  run(kRoughConductorGgx, RoughConductorLobe<Ggx>{});
  run(kDielectric, DielectricLobe{});
}

void merge(Evaluation& into, const Evaluation& from, Mask lanes) {
  into.value = select(lanes, from.value, into.value);
  into.pdf_solid_angle = select(lanes, from.pdf_solid_angle, into.pdf_solid_angle);
}

void merge(Sample& into, const Sample& from, Mask lanes) {
  into.wi = select(lanes, from.wi, into.wi);
  into.weight = select(lanes, from.weight, into.weight);
  into.pdf_solid_angle = select(lanes, from.pdf_solid_angle, into.pdf_solid_angle);
  into.eta = select(lanes, from.eta, into.eta);
  into.valid = into.valid | (from.valid & lanes);
  into.delta = into.delta | (from.delta & lanes);
}

}  // namespace

Materials::Materials(const std::vector<scene::Bsdf>& bsdfs) {
  std::vector<Side> sides(bsdfs.size());
  for (size_t i = 0; i < bsdfs.size(); ++i) {
    if (!std::holds_alternative<scene::TwoSided>(bsdfs[i].model)) sides[i] = add_lobe(bsdfs[i]);
  }
  for (size_t i = 0; i < bsdfs.size(); ++i) {
    const auto* pair = std::get_if<scene::TwoSided>(&bsdfs[i].model);
    const bool through = sides[i].kind == kDielectric;  // sees both sides in one frame
    const Side front = pair != nullptr ? sides[pair->front] : sides[i];
    const Side back = pair != nullptr ? sides[pair->back] : through ? sides[i] : Side{};
    front_kind_.push_back(front.kind);
    front_row_.push_back(front.row);
    back_kind_.push_back(back.kind);
    back_row_.push_back(back.row);
    two_sided_.push_back(pair != nullptr ? 1 : 0);
  }
}

Materials::Side Materials::add_lobe(const scene::Bsdf& bsdf) {
  Side side;
  if (const auto* diffuse = std::get_if<scene::Diffuse>(&bsdf.model)) {
    side = {kDiffuse, DiffuseLobe::add(parameters_, *diffuse)};
  } else if (const auto* conductor = std::get_if<scene::Conductor>(&bsdf.model)) {
    side = {kConductor, ConductorLobe::add(parameters_, *conductor)};
  } else if (const auto* rough = std::get_if<scene::RoughConductor>(&bsdf.model)) {
    const bool ggx = rough->distribution == scene::Microfacet::kGgx;
    side = {ggx ? kRoughConductorGgx : kRoughConductorBeckmann,
            RoughConductorLobe<Ggx>::add(parameters_, *rough)};
    wants_tangent_ = wants_tangent_ || rough->alpha_u != rough->alpha_v;
  } else {
    const auto* dielectric = std::get_if<scene::Dielectric>(&bsdf.model);
    METROFARM_CHECK(dielectric != nullptr);
    side = {kDielectric, DielectricLobe::add(parameters_, *dielectric)};
  }
  kinds_present_ |= 1U << side.kind;
  return side;
}

ShownLobe Materials::shown(Int bsdf, Mask front, Mask lanes) const {
  const Mask front_lanes = lanes & front;
  const Mask back_lanes = lanes & ~front;
  ShownLobe lobe;
  lobe.kind = select(front_lanes, gather(front_kind_.data(), bsdf, front_lanes), Int(-1));
  lobe.row = gather(front_row_.data(), bsdf, front_lanes);
  if (any(back_lanes)) {
    lobe.kind = select(back_lanes, gather(back_kind_.data(), bsdf, back_lanes), lobe.kind);
    lobe.row = select(back_lanes, gather(back_row_.data(), bsdf, back_lanes), lobe.row);
    lobe.turned = back_lanes & equal(gather(two_sided_.data(), bsdf, back_lanes), Int(1));
  }
  return lobe;
}

Evaluation Materials::evaluate(const ShownLobe& lobe, Mask lanes, const Vec3& wo,
                               const Vec3& wi) const {
  Evaluation result;
  for_each_kind(kinds_present_, lobe.kind, lanes, [&](auto model, Mask here) {
    merge(result, model.evaluate(parameters_, lobe.row, here, wo, wi), here);
  });
  return result;
}

Sample Materials::sample(const ShownLobe& lobe, Mask lanes, const Vec3& wo,
                         const SampleInput& u) const {
  Sample result;
  for_each_kind(kinds_present_, lobe.kind, lanes, [&](auto model, Mask here) {
    merge(result, model.sample(parameters_, lobe.row, here, wo, u), here);
  });
  return result;
}

Mask Materials::smooth(const ShownLobe& lobe, Mask lanes) const {
  Mask result = no_lanes();
  for (int k = 0; k < kLobeKinds; ++k) {
    const bool has_density = (kDeltaKinds >> k & 1U) == 0 && (kinds_present_ >> k & 1U) != 0;
    if (has_density) result = result | (lanes & equal(lobe.kind, Int(k)));
  }
  return result;
}

}  // namespace metrofarm::bsdf
