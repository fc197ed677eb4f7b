#include "bsdf/graph.h"

#include "base/check.h"

namespace metrofarm::bsdf {
namespace {

// The mirror image of directions in the surface.
Vec3 mirrored(const Vec3& v) {
  return {v.x, v.y, -v.z};
}

Vec3 in_current_frame(const Walk& w, const Vec3& v) {
  return select(w.bent, w.inner.to_local(v), v);
}

}  // namespace

Graph::Graph(const std::vector<scene::Bsdf>& bsdfs, const texture::Textures& textures)
    : textures_(textures), nodes_(bsdfs.size()) {
  for (int i = 0; i < static_cast<int>(bsdfs.size()); ++i) {
    const auto& model = bsdfs[i].model;
    if (const auto* mask = std::get_if<scene::Mask>(&model)) {
      add_wrapper(i, kMaskWrapper, {mask->opacity.value, mask->opacity.texture, mask->nested, 0});
    } else if (const auto* blend = std::get_if<scene::Blend>(&model)) {
      add_wrapper(i, kBlendWrapper,
                  {blend->weight.value, blend->weight.texture, blend->first, blend->second});
    } else if (const auto* relief = std::get_if<scene::BumpMap>(&model)) {
      add_wrapper(i, kBumpWrapper,
                  {relief->displacement.value, relief->displacement.texture, relief->nested, 0});
    } else if (const auto* map = std::get_if<scene::NormalMap>(&model)) {
      add_wrapper(i, kNormalWrapper, {1, map->normals, map->nested, 0});
    }
  }
}

void Graph::add_wrapper(int index, WrapperKind kind, const Wrapper& wrapper) {
  nodes_[index] = {kind, static_cast<int32_t>(wrapper_value_.size())};
  wrapper_value_.push_back(wrapper.value);
  wrapper_texture_.push_back(wrapper.texture);
  wrapper_first_.push_back(wrapper.first);
  wrapper_second_.push_back(wrapper.second);
  has_wrappers_ = true;
  const bool mixture = kind == kMaskWrapper || kind == kBlendWrapper;
  mixes_ = mixes_ || mixture;
  bends_ = bends_ || !mixture;
  textured_ = textured_ || wrapper.texture != scene::kNone;
}

void Graph::set_model(int index, int32_t kind, int32_t row) {
  nodes_[index] = {kind, row};
}

Graph::Entry Graph::resolve(const std::vector<scene::Bsdf>& bsdfs, int index, bool front) const {
  const auto* pair = std::get_if<scene::TwoSided>(&bsdfs[index].model);
  if (pair != nullptr) return resolve(bsdfs, front ? pair->front : pair->back, true);
  const Entry node = nodes_[index];
  const bool through = node.kind >= kLobeKinds || (kThroughKinds & kind_bit(node.kind)) != 0;
  return front || through ? node : Entry{};
}

void Graph::finish(const std::vector<scene::Bsdf>& bsdfs) {
  for (int i = 0; i < static_cast<int>(bsdfs.size()); ++i) {
    for (bool front : {true, false}) {
      const Entry entry = resolve(bsdfs, i, front);
      entry_kind_.push_back(entry.kind);
      entry_row_.push_back(entry.row);
    }
    two_sided_.push_back(std::holds_alternative<scene::TwoSided>(bsdfs[i].model) ? 1 : 0);
    has_two_sided_ = has_two_sided_ || two_sided_.back() != 0;
  }
}

void Graph::walk(Int bsdf, Mask lanes, Walk& w) const {
  enter(bsdf, lanes, w);
  if (!has_wrappers_) return;
  for (size_t depth = 0;; ++depth) {
    const Mask inside = lanes & ~as_mask(Int(kLobeKinds) > w.kind);
    if (none(inside)) return;
    METROFARM_CHECK(depth <= two_sided_.size());  // importers make no cycles
    descend(inside, w);
  }
}

void Graph::enter(Int bsdf, Mask lanes, Walk& w) const {
  Float cosine = w.wo.z;
  if (bends_) cosine = select(w.bent, dot(w.wo, w.inner.n), cosine);
  const Mask back = lanes & ~(cosine > Float(0.F));
  const Int entry = bsdf + bsdf + select(back, Int(1), Int(0));
  w.kind = select(lanes, gather(entry_kind_.data(), entry, lanes), w.kind);
  w.row = select(lanes, gather(entry_row_.data(), entry, lanes), w.row);
  if (!has_two_sided_ || none(back)) return;
  const Mask turned = back & equal(gather(two_sided_.data(), bsdf, back), Int(1));
  if (any(turned)) turn(turned, w);
}

// The material treats its back like a front: all directions are mirrored in the shading plane, and
// so is the bent frame, which leaves directions their coordinates in it but for the sign of z.
void Graph::turn(Mask lanes, Walk& w) const {
  w.turned = w.turned | lanes;
  w.wo = select(lanes, mirrored(w.wo), w.wo);
  const Mask both = lanes & w.bent;
  if (none(both)) return;
  w.inner.s = select(both, mirrored(w.inner.s), w.inner.s);
  w.inner.t = select(both, mirrored(w.inner.t), w.inner.t);
  w.inner.n = select(both, -mirrored(w.inner.n), w.inner.n);
}

void Graph::descend(Mask lanes, Walk& w) const {
  const auto run = [&](WrapperKind kind, void (Graph::*step)(Mask, Walk&) const) {
    const Mask here = lanes & equal(w.kind, Int(kind));
    if (any(here)) (this->*step)(here, w);
    lanes = lanes & ~here;  // one step each
  };
  run(kMaskWrapper, &Graph::choose_opacity);
  run(kBlendWrapper, &Graph::choose_blend);
  run(kBumpWrapper, &Graph::bump);
  run(kNormalWrapper, &Graph::map_normal);
}

// A weight in [0, 1].
Float Graph::wrapper_value(Int wrapper, Mask lanes, const Walk& w) const {
  Float value = gather(wrapper_value_.data(), wrapper, lanes);
  const Int texture = gather(wrapper_texture_.data(), wrapper, lanes);
  const Mask textured = lanes & as_mask(texture >= Int(0));
  if (any(textured)) {
    value = select(textured, value * textures_.luminance(texture, w.point, textured), value);
  }
  return xsimd::min(xsimd::max(value, Float(0.F)), Float(1.F));
}

void Graph::choose_opacity(Mask lanes, Walk& w) const {
  const Int wrapper = w.row;
  const Float opacity = wrapper_value(wrapper, lanes, w);
  const Mask opaque = lanes & (w.choice < opacity);
  w.choice = select(opaque, w.choice / opacity, w.choice);
  w.kind = select(lanes & ~opaque, Int(kNull), w.kind);
  w.row = select(lanes & ~opaque, Int(0), w.row);
  if (any(opaque)) enter(gather(wrapper_first_.data(), wrapper, opaque), opaque, w);
}

void Graph::choose_blend(Mask lanes, Walk& w) const {
  const Int wrapper = w.row;
  const Float weight = wrapper_value(wrapper, lanes, w);
  const Mask second = w.choice < weight;
  const Float rest = (w.choice - weight) / (Float(1.F) - weight);
  const Float rescaled = select(second, w.choice / weight, rest);
  w.choice = select(lanes, xsimd::min(rescaled, Float(kOneMinusEpsilon)), w.choice);
  const Int nested = select(second, gather(wrapper_second_.data(), wrapper, lanes),
                            gather(wrapper_first_.data(), wrapper, lanes));
  enter(nested, lanes, w);
}

// The normal of the displaced surface (Blinn 1978), the second fundamental form left out.
void Graph::bump(Mask lanes, Walk& w) const {
  const Int wrapper = w.row;
  const Float scale = gather(wrapper_value_.data(), wrapper, lanes);
  const Int texture = gather(wrapper_texture_.data(), wrapper, lanes);
  const Mask textured = lanes & as_mask(texture >= Int(0));
  const texture::Gradient slope = textures_.gradient(texture, w.point, textured);
  const Vec3 du = in_current_frame(w, w.dp_du), dv = in_current_frame(w, w.dp_dv);
  const Vec3 bumped_u{du.x, du.y, keep(textured, slope.du * scale)};
  const Vec3 bumped_v{dv.x, dv.y, keep(textured, slope.dv * scale)};
  const Vec3 n = cross(bumped_u, bumped_v);
  // To the side of the geometric normal, which is the one that the shading normal is nearer to.
  const Vec3 flat = cross(du, dv);
  const Mask below = dot(flat, n) * flat.z < Float(0.F);
  bend(select(below, -n, n), lanes, w);
  enter(gather(wrapper_first_.data(), wrapper, lanes), lanes, w);
}

void Graph::map_normal(Mask lanes, Walk& w) const {
  const Int wrapper = w.row;
  const Int texture = gather(wrapper_texture_.data(), wrapper, lanes);
  const Spectrum rgb = textures_.colour(texture, w.point, lanes);
  bend(rgb * Float(2.F) - splat(1.F), lanes, w);
  enter(gather(wrapper_first_.data(), wrapper, lanes), lanes, w);
}

// Tilts the current frame to the normal n, given in its coordinates at any length. A normal that
// faces away from wo is turned about the old one (Schuessler et al. 2017, section 4.1).
void Graph::bend(Vec3 n, Mask lanes, Walk& w) const {
  const Vec3 wo = in_current_frame(w, w.wo);
  const Mask away = wo.z * dot(wo, n) <= Float(0.F);
  n = select(away, Vec3{-n.x, -n.y, n.z}, n);
  const Float length2 = length_squared(n);
  n = select(length2 > Float(0.F), n / xsimd::sqrt(length2), splat(0, 0, 1));
  const Vec3 along = splat(1, 0, 0) - n * n.x;
  const Float across2 = length_squared(along);
  const Vec3 s = select(across2 > Float(0.F), along / xsimd::sqrt(across2), splat(0, 1, 0));
  const Frame local{s, cross(n, s), n};
  const auto outward = [&](const Vec3& v) { return select(w.bent, w.inner.to_world(v), v); };
  const Frame bent{outward(local.s), outward(local.t), outward(local.n)};
  w.inner.s = select(lanes, bent.s, w.inner.s);
  w.inner.t = select(lanes, bent.t, w.inner.t);
  w.inner.n = select(lanes, bent.n, w.inner.n);
  w.bent = w.bent | lanes;
}

}  // namespace metrofarm::bsdf
