#include "tests/bsdf/chart.h"

#include <cmath>
#include <numbers>

namespace metrofarm::bsdf::test {

using std::numbers::pi;

Chart::Point SphereChart::at(double u, double v) const {
  const double z = 2 * u - 1;
  const double r = std::sqrt(1 - z * z);
  return {{r * std::cos(2 * pi * v), r * std::sin(2 * pi * v), z}, 4 * pi};
}

std::pair<double, double> SphereChart::locate(Double3 wi) const {
  return {0.5 + 0.5 * wi.z, metrofarm::test::turns(wi.x, wi.y)};
}

Chart::Point HalfVectorChart::at(double u, double v) const {
  const double cosine = 1 - u;  // of the unstretched slope's angle
  const double r = std::sqrt(1 - cosine * cosine) / cosine;
  const Double3 m = normalize(
      Double3{r * alpha_u_ * std::cos(2 * pi * v), r * alpha_v_ * std::sin(2 * pi * v), 1});
  const double incidence = dot(wo_, m);
  // Slopes: dp dq = alpha_u alpha_v r dr dphi = alpha_u alpha_v 2 pi / (1 - u)^3 du dv; normals:
  // cos^3 of that; mirror directions: 4 (wo . m) of that (Walter et al. 2007, eq. 14).
  const double slopes = alpha_u_ * alpha_v_ * 2 * pi / (cosine * cosine * cosine);
  return {m * (2 * incidence) - wo_, slopes * m.z * m.z * m.z * 4 * std::fabs(incidence)};
}

std::pair<double, double> HalfVectorChart::locate(Double3 wi) const {
  const Double3 m = wo_ + wi;
  const double p = m.x / (m.z * alpha_u_), q = m.y / (m.z * alpha_v_);
  return {1 - 1 / std::sqrt(1 + p * p + q * q), metrofarm::test::turns(p, q)};
}

}  // namespace metrofarm::bsdf::test
