#include "bsdf/rough_transmittance.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "bsdf/fresnel.h"
#include "bsdf/microfacet.h"

namespace metrofarm::bsdf {
namespace {

struct Quadrature {
  std::vector<float> nodes, weights;  // on [0, 1], weights sum to 1; whole packets of lanes
};

// Gauss-Legendre: roots of the Legendre polynomial by Newton's method.
Quadrature gauss_legendre(int count) {
  Quadrature q;
  for (int i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5)), slope = 1;
    for (int step = 0; step < 20; ++step) {
      double before = 1, value = x;
      for (int k = 2; k <= count; ++k) {
        const double next = ((2 * k - 1) * x * value - (k - 1) * before) / k;
        before = value;
        value = next;
      }
      slope = count * (x * value - before) / (x * x - 1);
      x -= value / slope;
    }
    q.nodes.push_back(static_cast<float>(0.5 + 0.5 * x));
    q.weights.push_back(static_cast<float>(1 / ((1 - x * x) * slope * slope)));
  }
  return q;
}

// Share of light arriving at this cosine that single scattering reflects, or lets through.
// eta: index beyond over index before the boundary.
template <class Distribution>
double share(double cosine, float alpha, float eta, bool transmitted, const Quadrature& q) {
  const Roughness a = roughness(Float(alpha), Float(alpha));
  const Vec3 wo =
      splat(static_cast<float>(std::sqrt(1 - cosine * cosine)), 0.F, static_cast<float>(cosine));
  double sum = 0;
  for (size_t row = 0; row < q.nodes.size(); ++row) {
    Float row_sum(0.F);
    for (size_t first = 0; first < q.nodes.size(); first += kLanes) {
      const Vec2 u{Float(q.nodes[row]), Float::load_unaligned(q.nodes.data() + first)};
      const Vec3 m = Distribution::sample_normal(wo, u, a);
      const Float cos_m = dot(wo, m);
      const DielectricInterface boundary = fresnel_dielectric(cos_m, Float(eta));
      const Float inverse(1.F / eta);
      const Vec3 mirrored = m * (Float(2.F) * cos_m) - wo;
      const Vec3 refracted = m * (cos_m * inverse - boundary.cos_transmitted) - wo * inverse;
      const Vec3 wi = transmitted ? refracted : mirrored;
      const Float part = transmitted ? Float(1.F) - boundary.reflectance : boundary.reflectance;
      const Mask seen = (transmitted ? -wi.z : wi.z) > Float(0.F);
      const Float weight = keep(seen & (cos_m > Float(0.F)), Distribution::masking(wi, a) * part);
      row_sum = row_sum + weight * Float::load_unaligned(q.weights.data() + first);
    }
    sum += double(q.weights[row]) * xsimd::hadd(row_sum);
  }
  return sum;
}

// As many nodes as Mitsuba takes, so that the same error is made: from inside, total reflection
// asks for more.
template <class Distribution>
float fill(float alpha, float eta, float* transmittance) {
  constexpr int kEntries = TransmittanceTables::kEntries;
  const Quadrature outside = gauss_legendre(eta > 1 ? 32 : 128);
  const Quadrature inside = gauss_legendre(1 / eta > 1 ? 32 : 128);
  double reflected = 0;
  for (int i = 0; i < kEntries; ++i) {
    const double cosine = std::max(1e-6, i / (kEntries - 1.0));
    transmittance[i] = static_cast<float>(share<Distribution>(cosine, alpha, eta, true, outside));
    reflected += cosine * share<Distribution>(cosine, alpha, 1 / eta, false, inside);
  }
  return static_cast<float>(2 * reflected / kEntries);
}

}  // namespace

TransmittanceTables::Coating TransmittanceTables::add(scene::Microfacet distribution, float alpha,
                                                      float eta) {
  for (const Known& k : known_) {
    if (k.distribution == distribution && k.alpha == alpha && k.eta == eta) return k.coating;
  }
  Coating coating;
  coating.table = static_cast<int>(known_.size());
  values_.resize(values_.size() + kEntries);
  float* table = values_.data() + size_t(coating.table) * kEntries;
  coating.internal_reflectance = distribution == scene::Microfacet::kGgx
                                     ? fill<Ggx>(alpha, eta, table)
                                     : fill<Beckmann>(alpha, eta, table);
  known_.push_back({distribution, alpha, eta, coating});
  return coating;
}

}  // namespace metrofarm::bsdf
