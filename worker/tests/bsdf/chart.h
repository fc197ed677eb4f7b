// Charts: the unit square mapped to directions in a way that spreads a lobe out, so that a grid of
// equal cells resolves it however narrow it is. Independent of the code under test, in doubles.
#pragma once

#include <utility>

#include "tests/support/lane_tools.h"

namespace metrofarm::bsdf::test {

using metrofarm::test::Double3;

// Which directions below the surface a material sends light to.
enum class Below { kNothing, kRefracted, kMirrored };

class Chart {
 public:
  virtual ~Chart() = default;
  // The direction at (u, v) and the solid angle per area of the square there; 0 where the point
  // names no direction.
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

// Directions by the microfacet normal that joins them to wo: v is its azimuth, u the logarithm of
// its angle to the surface normal beyond the roughness (alpha_u, alpha_v), linear within, so that
// narrow and wide lobes are both resolved. Where light passes, u < 1/2 charts the side of wo and
// u > 1/2 the other side: refracted, or mirrored in the surface.
class FacetChart final : public Chart {
 public:
  // eta: index below the surface over the index above it.
  FacetChart(Double3 wo, double alpha_u, double alpha_v, Below below, double eta);
  Point at(double u, double v) const override;
  std::pair<double, double> locate(Double3 wi) const override;

 private:
  Double3 normal_at(double u, double v, double& jacobian) const;

  Double3 wo_;  // on the upper side
  double side_;
  double alpha_u_, alpha_v_, alpha_, range_;
  Below below_;
  double eta_;
};

}  // namespace metrofarm::bsdf::test
