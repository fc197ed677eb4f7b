// How much light a rough dielectric boundary lets through, as tables over the cosine of incidence:
// what rough plastic needs to know of its coating.
#pragma once

#include <vector>

#include "math/lanes.h"
#include "scene/description.h"

namespace metrofarm::bsdf {

class TransmittanceTables {
 public:
  static constexpr int kEntries = 64;  // at equal steps of the cosine from 0 to 1

  struct Coating {
    int table = 0;
    float internal_reflectance = 0;  // diffuse light from below that comes back
  };

  // Finds or makes the table of a boundary of this roughness and index ratio (below over above).
  Coating add(scene::Microfacet distribution, float alpha, float eta);

  const float* data() const { return values_.data(); }

  // Transmittance from outside at each lane's table and cosine in [0, 1].
  static Float look_up(const float* data, Int table, Float cosine, Mask lanes) {
    const Float at = cosine * Float(kEntries - 1.F);
    const Int entry = xsimd::min(truncate(at), Int(kEntries - 2));
    const Int index = table * Int(kEntries) + entry;
    const Float low = gather(data, index, lanes), high = gather(data + 1, index, lanes);
    return low + (high - low) * (at - to_float(entry));
  }

 private:
  struct Known {
    scene::Microfacet distribution;
    float alpha, eta;
    Coating coating;
  };
  std::vector<Known> known_;
  std::vector<float> values_;
};

}  // namespace metrofarm::bsdf
