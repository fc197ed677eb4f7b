// All materials of a scene: finds the lobe that a surface shows to a ray, resolves its parameters
// and sends each lane to its model. Only models that some lane needs are run.
//
// A material is a small graph: wrappers (two-sided, mask, blend, bump and normal maps) around
// models that scatter. show() walks it once per vertex and ends at one model per lane. Mixtures are
// chosen at random, mask and blend alike, by a coordinate of the vertex: everything that is
// evaluated at the vertex afterwards is that component alone, which is unbiased because the choice
// looks at nothing but the vertex.
#pragma once

#include <cstdint>
#include <vector>

#include "bsdf/graph.h"
#include "bsdf/parameters.h"
#include "bsdf/types.h"
#include "geometry/surface.h"
#include "scene/description.h"
#include "texture/textures.h"

namespace metrofarm::bsdf {

// What a ray meets at a vertex.
struct ShownLobe {
  Int kind = Int(-1);        // LobeKind, -1: black
  Mask turned = no_lanes();  // the material treats this back side like a front
  Mask bent = no_lanes();    // lanes whose normal a map has changed
  Frame inner;            // in bent lanes: the model's frame, in coordinates of the shading frame
  Parameters parameters;  // of each lane's model
};

// What the shown lobe depends on.
struct ShadingPoint {
  geometry::SurfacePoint point;
  // In the (not yet turned) shading frame; only read where needs().tangents.
  Vec3 dp_du, dp_dv;
  Vec3 wo;
};

class Materials {
 public:
  // textures: outlives this.
  Materials(const std::vector<scene::Bsdf>& bsdfs, const texture::Textures& textures);

  // What must be known of a surface before show().
  geometry::SurfaceNeeds needs() const;
  // True if some material is a mixture, so that show() reads its choice.
  bool wants_choice() const;

  // The lobe of material `bsdf` at a point. choice: uniform in [0, 1).
  ShownLobe show(Int bsdf, const ShadingPoint& at, Float choice, Mask lanes) const;

  // wo and wi in the shading frame, turned where lobe.turned.
  Evaluation evaluate(const ShownLobe& lobe, Mask lanes, const Vec3& wo, const Vec3& wi,
                      Transport transport) const;
  Sample sample(const ShownLobe& lobe, Mask lanes, const Vec3& wo, const SampleInput& u,
                Transport transport) const;
  // Lanes whose lobe has a density, so that light sampling can reach them.
  Mask smooth(const ShownLobe& lobe, Mask lanes) const;
  // Lanes whose lobe is black wherever wi.z <= 0.
  Mask one_sided(const ShownLobe& lobe, Mask lanes) const;

 private:
  struct Model {
    int32_t kind, row;
  };

  Mask shows_any(uint32_t kinds, const ShownLobe& lobe, Mask lanes) const;
  Model add_model(const scene::Bsdf& bsdf);
  template <class Scene>
  Model add_rough(const Scene& model, int32_t beckmann, const Row& row);
  void load_parameters(Int row, Mask lanes, const geometry::SurfacePoint& point,
                       ShownLobe& lobe) const;

  const texture::Textures& textures_;
  ParameterTable parameters_;
  TransmittanceTables transmittance_;
  Graph graph_;
  uint32_t kinds_present_ = 0;  // bits of LobeKind
  bool anisotropic_ = false;
};

}  // namespace metrofarm::bsdf
