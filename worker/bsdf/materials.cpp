#include "bsdf/materials.h"

#include <algorithm>

namespace metrofarm::bsdf {
namespace {

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

// The shadow that a bumped surface casts on itself, for light from wi (outside the bent frame):
// Conty Estevez et al. 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator
// Problem", eq. 3.
Float bump_shadow(const Vec3& n, const Vec3& wi) {
  const auto tan2 = [](const Vec3& v) { return (sqr(v.x) + sqr(v.y)) / sqr(v.z); };
  const Float alpha2 = xsimd::min(Float(0.125F) * tan2(n), Float(1.F));
  return Float(2.F) / (Float(1.F) + xsimd::sqrt(Float(1.F) + alpha2 * tan2(wi)));
}

bool differ(const scene::Scalar& a, const scene::Scalar& b) {
  return a.value != b.value || a.texture != b.texture;
}

bool is_anisotropic(const scene::Bsdf& bsdf) {
  return std::visit(
      []<class Model>(const Model& m) {
        if constexpr (requires { m.alpha_u; }) {
          return differ(m.alpha_u, m.alpha_v);
        } else if constexpr (requires { m.anisotropic; }) {
          return m.anisotropic.value != 0;
        } else {
          return false;
        }
      },
      bsdf.model);
}

}  // namespace

Materials::Materials(const std::vector<scene::Bsdf>& bsdfs, const texture::Textures& textures)
    : textures_(textures), graph_(bsdfs, textures) {
  parameters_.add({});  // row 0: read by lanes that show nothing
  kinds_present_ = graph_.mixes() ? kind_bit(kNull) : 0;
  for (size_t i = 0; i < bsdfs.size(); ++i) {
    const Model model = add_model(bsdfs[i]);
    if (model.kind == kBlack) continue;
    graph_.set_model(static_cast<int>(i), model.kind, model.row);
    kinds_present_ |= kind_bit(model.kind);
    anisotropic_ = anisotropic_ || is_anisotropic(bsdfs[i]);
  }
  graph_.finish(bsdfs);
}

template <class Scene>
Materials::Model Materials::add_rough(const Scene& model, int32_t beckmann, const Row& row) {
  const bool ggx = model.distribution == scene::Microfacet::kGgx;
  return {ggx ? beckmann + 1 : beckmann, parameters_.add(row)};
}

// kBlack for wrappers, which are no models.
Materials::Model Materials::add_model(const scene::Bsdf& bsdf) {
  const auto& m = bsdf.model;
  if (const auto* d = std::get_if<scene::Diffuse>(&m))
    return {kDiffuse, parameters_.add(DiffuseLobe::row(*d))};
  if (const auto* d = std::get_if<scene::Conductor>(&m))
    return {kConductor, parameters_.add(ConductorLobe::row(*d))};
  if (const auto* d = std::get_if<scene::RoughConductor>(&m))
    return add_rough(*d, kRoughConductorBeckmann, RoughConductorLobe<Ggx>::row(*d));
  if (const auto* d = std::get_if<scene::Dielectric>(&m))
    return {kDielectric, parameters_.add(DielectricLobe::row(*d))};
  if (const auto* d = std::get_if<scene::ThinDielectric>(&m))
    return {kThinDielectric, parameters_.add(ThinDielectricLobe::row(*d))};
  if (const auto* d = std::get_if<scene::RoughDielectric>(&m))
    return add_rough(*d, kRoughDielectricBeckmann, RoughDielectricLobe<Ggx>::row(*d));
  if (const auto* d = std::get_if<scene::Plastic>(&m))
    return {kPlastic, parameters_.add(PlasticLobe::row(*d))};
  if (const auto* d = std::get_if<scene::RoughPlastic>(&m))
    return add_rough(*d, kRoughPlasticBeckmann, RoughPlasticLobe<Ggx>::row(*d, transmittance_));
  if (const auto* d = std::get_if<scene::Phong>(&m))
    return {kPhong, parameters_.add(PhongLobe::row(*d))};
  if (const auto* d = std::get_if<scene::Principled>(&m))
    return {kPrincipled, parameters_.add(PrincipledLobe::row(*d))};
  if (const auto* d = std::get_if<scene::PrincipledThin>(&m))
    return {kPrincipledThin, parameters_.add(PrincipledThinLobe::row(*d))};
  if (const auto* d = std::get_if<scene::DiffuseTransmitter>(&m))
    return {kDiffuseTransmitter, parameters_.add(DiffuseTransmitterLobe::row(*d))};
  if (std::holds_alternative<scene::Null>(m)) return {kNull, 0};
  return {kBlack, 0};
}

geometry::SurfaceNeeds Materials::needs() const {
  geometry::SurfaceNeeds needs;
  needs.uv = parameters_.textured() || graph_.textured();
  needs.tangents = anisotropic_ || graph_.bends();
  return needs;
}

bool Materials::wants_choice() const {
  return graph_.mixes();
}

ShownLobe Materials::show(Int bsdf, const ShadingPoint& at, Float choice, Mask lanes) const {
  Walk walk{at.point, at.dp_du, at.dp_dv, at.wo, choice};
  graph_.walk(bsdf, lanes, walk);
  ShownLobe lobe;
  lobe.kind = walk.kind;
  lobe.turned = walk.turned;
  lobe.bent = walk.bent;
  if (graph_.bends()) lobe.inner = walk.inner;
  load_parameters(walk.row, lanes, at.point, lobe);
  return lobe;
}

void Materials::load_parameters(Int row, Mask lanes, const geometry::SurfacePoint& point,
                                ShownLobe& lobe) const {
  int count = 0;
  for_each_kind(kinds_present_, lobe.kind, lanes,
                [&]<class Model>(Model, Mask) { count = std::max(count, Model::kColumns); });
  parameters_.load(row, lanes, count, lobe.parameters);
  lobe.parameters.transmittance = transmittance_.data();
  if (!parameters_.textured()) return;
  Float* columns = lobe.parameters.columns;
  parameters_.for_each_texture(
      row, lanes,
      [&](int column, Int texture, Mask here) {
        const Spectrum colour = textures_.colour(texture, point, here);
        const Float channels[3] = {colour.x, colour.y, colour.z};
        for (int k = 0; k < 3; ++k) {
          Float& value = columns[column + k];
          value = select(here, value * channels[k], value);
        }
      },
      [&](int column, Int texture, Mask here) {
        Float& value = columns[column];
        value = select(here, value * textures_.luminance(texture, point, here), value);
      });
}

Evaluation Materials::evaluate(const ShownLobe& lobe, Mask lanes, const Vec3& wo, const Vec3& wi,
                               Transport transport) const {
  const auto run = [&](const Vec3& o, const Vec3& i) {
    Evaluation result;
    for_each_kind(kinds_present_, lobe.kind, lanes, [&]<class Model>(Model, Mask here) {
      merge(result, Model::evaluate(lobe.parameters, here, o, i, transport), here);
    });
    return result;
  };
  if (none(lobe.bent & lanes)) return run(wo, wi);
  const Vec3 inner_wo = select(lobe.bent, lobe.inner.to_local(wo), wo);
  const Vec3 inner_wi = select(lobe.bent, lobe.inner.to_local(wi), wi);
  Evaluation e = run(inner_wo, inner_wi);
  // A direction on different sides of the two normals would leak through the surface.
  const Mask kept = ~lobe.bent | (wi.z * inner_wi.z > Float(0.F));
  const Float shadow = select(lobe.bent, bump_shadow(lobe.inner.n, wi), Float(1.F));
  return {keep(kept, e.value * shadow), keep(kept, e.pdf_solid_angle)};
}

Sample Materials::sample(const ShownLobe& lobe, Mask lanes, const Vec3& wo, const SampleInput& u,
                         Transport transport) const {
  const Mask bent = lobe.bent & lanes;
  const Vec3 inner_wo = any(bent) ? select(bent, lobe.inner.to_local(wo), wo) : wo;
  Sample s;
  for_each_kind(kinds_present_, lobe.kind, lanes, [&]<class Model>(Model, Mask here) {
    merge(s, Model::sample(lobe.parameters, here, inner_wo, u, transport), here);
  });
  if (none(bent)) return s;
  const Vec3 wi = lobe.inner.to_world(s.wi);
  s.valid = s.valid & (~bent | (wi.z * s.wi.z > Float(0.F)));
  s.weight = s.weight * select(bent, bump_shadow(lobe.inner.n, wi), Float(1.F));
  s.weight = keep(s.valid, s.weight);
  s.wi = select(bent, wi, s.wi);
  return s;
}

Mask Materials::shows_any(uint32_t kinds, const ShownLobe& lobe, Mask lanes) const {
  Mask result = no_lanes();
  for (int k = 0; k < kLobeKinds; ++k) {
    if ((kinds & kinds_present_ & kind_bit(k)) != 0)
      result = result | (lanes & equal(lobe.kind, Int(k)));
  }
  return result;
}

Mask Materials::smooth(const ShownLobe& lobe, Mask lanes) const {
  return shows_any(~kDeltaKinds, lobe, lanes);
}

Mask Materials::one_sided(const ShownLobe& lobe, Mask lanes) const {
  return lanes & ~lobe.bent & ~shows_any(kThroughKinds, lobe, lanes);
}

}  // namespace metrofarm::bsdf
