// All materials of a scene: finds the lobe that a surface shows to a ray and sends each lane to its
// model. Only models that some lane needs are run.
#pragma once

#include <cstdint>
#include <vector>

#include "bsdf/lobes.h"
#include "scene/description.h"

namespace metrofarm::bsdf {

// What a ray meets: which model with which parameters, and how to turn the frame for it.
struct ShownLobe {
  Int kind = Int(-1);        // LobeKind, -1: black
  Int row = Int(0);          // row in the parameter table
  Mask turned = no_lanes();  // the material treats this back side like a front
};

class Materials {
 public:
  explicit Materials(const std::vector<scene::Bsdf>& bsdfs);

  // The lobe of material `bsdf` seen from the side of the normal (front) or the other.
  ShownLobe shown(Int bsdf, Mask front, Mask lanes) const;
  Evaluation evaluate(const ShownLobe& lobe, Mask lanes, const Vec3& wo, const Vec3& wi) const;
  Sample sample(const ShownLobe& lobe, Mask lanes, const Vec3& wo, const SampleInput& u) const;
  // Lanes whose lobe has a density, so that light sampling can reach them.
  Mask smooth(const ShownLobe& lobe, Mask lanes) const;
  // True if some material needs the surface's tangent (anisotropic roughness).
  bool wants_tangent() const { return wants_tangent_; }

 private:
  struct Side {
    int32_t kind = -1;
    int32_t row = 0;
  };
  Side add_lobe(const scene::Bsdf& bsdf);

  ParameterTable parameters_;
  std::vector<int32_t> front_kind_, front_row_, back_kind_, back_row_, two_sided_;
  uint32_t kinds_present_ = 0;
  bool wants_tangent_ = false;
};

}  // namespace metrofarm::bsdf
