// The materials that the tests of this module run over.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bsdf/materials.h"
#include "tests/bsdf/chart.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::bsdf::test {

struct MaterialCase {
  std::string name;
  scene::Bsdf bsdf;
  double alpha_u = 1, alpha_v = 1;  // of the narrowest lobe; 1 without any
  Below below = Below::kNothing;
  double eta = 1;  // for refracted directions
  bool reciprocal = true;
  // Of a white furnace. Disney's models add their lobes without regard to energy, and Mitsuba's are
  // Disney's: a white base with full sheen reflects up to 1.41.
  double most_energy = 1;
};

// What mitsuba_values.py evaluates, by the same names.
std::vector<MaterialCase> mitsuba_cases();
// White materials for furnace, chi-square and reciprocity.
std::vector<MaterialCase> white_cases();

// One material (index 0 of `bsdfs` is shown) and its textures, at a point.
class Shown {
 public:
  explicit Shown(std::vector<scene::Bsdf> bsdfs, std::vector<scene::Texture> textures = {},
                 std::vector<scene::Image> images = {});
  explicit Shown(const MaterialCase& c) : Shown(std::vector<scene::Bsdf>{c.bsdf}) {}
  Shown(const Shown&) = delete;
  Shown& operator=(const Shown&) = delete;

  const Materials& materials() const { return materials_; }
  // As seen from wo, in the not yet turned frame, at texture coordinates (u, v).
  ShownLobe lobe(const Vec3& wo, Float choice = Float(0.5F), float u = 0.25F,
                 float v = 0.25F) const;

 private:
  texture::Images images_;
  geometry::Primitives primitives_;
  std::vector<scene::Texture> texture_list_;
  texture::Textures textures_;
  std::vector<scene::Bsdf> bsdfs_;
  Materials materials_;
};

std::unique_ptr<Chart> chart_of(const MaterialCase& c, metrofarm::test::Double3 wo);

}  // namespace metrofarm::bsdf::test
