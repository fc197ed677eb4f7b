// The materials of a scene as a graph of wrappers that ends at models, walked by eight lanes.
#pragma once

#include <cstdint>
#include <vector>

#include "bsdf/kinds.h"
#include "geometry/surface.h"
#include "texture/textures.h"

namespace metrofarm::bsdf {

// Wrappers continue the numbering of LobeKind.
enum WrapperKind : int32_t {
  kMaskWrapper = kLobeKinds,
  kBlendWrapper,
  kBumpWrapper,
  kNormalWrapper
};

// What the walk looks at: the surface, where the ray came from, and a random number.
struct Walk {
  const geometry::SurfacePoint& point;
  const Vec3& dp_du;  // in the not yet turned shading frame
  const Vec3& dp_dv;
  Vec3 wo;  // in the shading frame, turned where `turned`
  Float choice;

  // Result.
  Int kind = Int(kBlack);  // LobeKind; a WrapperKind while the walk goes on
  Int row = Int(0);        // of the model's parameters
  Mask turned = no_lanes();
  Mask bent = no_lanes();
  Frame inner = {splat(1, 0, 0), splat(0, 1, 0), splat(0, 0, 1)};
};

class Graph {
 public:
  // textures: outlives this.
  Graph(const std::vector<scene::Bsdf>& bsdfs, const texture::Textures& textures);

  // Names the model of bsdf `index`, which is no wrapper.
  void set_model(int index, int32_t kind, int32_t row);
  // bsdfs: as given to the constructor. Requires: every model has been named.
  void finish(const std::vector<scene::Bsdf>& bsdfs);

  bool mixes() const { return mixes_; }
  bool bends() const { return bends_; }
  bool textured() const { return textured_; }

  // Goes from each lane's material to its model.
  void walk(Int bsdf, Mask lanes, Walk& w) const;

 private:
  // What a material shows on one side. Two-sided materials are resolved here already: walking
  // through them costs nothing but the turn.
  struct Entry {
    int32_t kind = kBlack;
    int32_t row = 0;  // of parameters, or of the wrapper
  };
  struct Wrapper {
    float value = 1;
    int32_t texture = scene::kNone;
    int32_t first = 0, second = 0;  // nested materials
  };

  void add_wrapper(int index, WrapperKind kind, const Wrapper& wrapper);
  Entry resolve(const std::vector<scene::Bsdf>& bsdfs, int index, bool front) const;
  void enter(Int bsdf, Mask lanes, Walk& w) const;
  void turn(Mask lanes, Walk& w) const;
  void descend(Mask lanes, Walk& w) const;
  Float wrapper_value(Int wrapper, Mask lanes, const Walk& w) const;
  void choose_opacity(Mask lanes, Walk& w) const;
  void choose_blend(Mask lanes, Walk& w) const;
  void bump(Mask lanes, Walk& w) const;
  void map_normal(Mask lanes, Walk& w) const;
  void bend(Vec3 n, Mask lanes, Walk& w) const;

  const texture::Textures& textures_;
  std::vector<Entry> nodes_;                     // by material, as if one-sided
  std::vector<int32_t> entry_kind_, entry_row_;  // front and back of each material in turn
  std::vector<int32_t> two_sided_;               // by material
  std::vector<float> wrapper_value_;
  std::vector<int32_t> wrapper_texture_, wrapper_first_, wrapper_second_;
  bool has_wrappers_ = false, has_two_sided_ = false;
  bool mixes_ = false, bends_ = false, textured_ = false;
};

}  // namespace metrofarm::bsdf
