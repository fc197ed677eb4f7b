// Charts: the unit square mapped to directions in a way that spreads a lobe out, so that a grid of
// equal cells resolves it however narrow it is. Independent of the code under test, in doubles.
#pragma once

#include <utility>

#include "tests/support/lane_tools.h"

namespace metrofarm::bsdf::test {

using metrofarm::test::Double3;

class Chart {
 public:
  virtual ~Chart() = default;
  // The direction at (u, v) and the solid angle per area of the square there.
  struct Point {
    Double3 wi;
    double jacobian;
  };
  virtual Point at(double u, double v) const = 0;
  // (u, v) of a direction.
  virtual std::pair<double, double> locate(Double3 wi) const = 0;
};

// The whole sphere: height and azimuth.
class SphereChart final : public Chart {
 public:
  Point at(double u, double v) const override;
  std::pair<double, double> locate(Double3 wi) const override;
};

// Mirror directions of wo about microfacet normals: u spreads the slopes, scaled by the roughness
// (alpha_u, alpha_v), as 1 - 1 / sqrt(1 + r^2), v is their azimuth. The tails of GGX stay bounded
// under it even where visible normals are weighted by their slope.
class HalfVectorChart final : public Chart {
 public:
  HalfVectorChart(Double3 wo, double alpha_u, double alpha_v)
      : wo_(wo), alpha_u_(alpha_u), alpha_v_(alpha_v) {}
  Point at(double u, double v) const override;
  std::pair<double, double> locate(Double3 wi) const override;

 private:
  Double3 wo_;
  double alpha_u_, alpha_v_;
};

}  // namespace metrofarm::bsdf::test
