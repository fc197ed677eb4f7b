#include "tests/bsdf/chart.h"

#include <algorithm>
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

FacetChart::FacetChart(Double3 wo, double alpha_u, double alpha_v, Below below, double eta)
    : wo_{wo.x, wo.y, std::fabs(wo.z)},
      side_(wo.z < 0 ? -1 : 1),
      alpha_u_(alpha_u),
      alpha_v_(alpha_v),
      alpha_(std::min(alpha_u, alpha_v)),
      range_(std::asinh(pi / (2 * alpha_))),
      below_(below),
      eta_(wo.z < 0 ? 1 / eta : eta) {}

// The facet normal at (u, v) of one half, and the solid angle of normals per area there: angle
// theta = alpha sinh(u range) before the slopes are stretched by alpha_u / alpha and
// alpha_v / alpha, which changes solid angles by cos^3 of the new over cos^3 of the old angle.
Double3 FacetChart::normal_at(double u, double v, double& jacobian) const {
  const double theta = alpha_ * std::sinh(u * range_);
  const double stretch_u = alpha_u_ / alpha_, stretch_v = alpha_v_ / alpha_;
  const double sine = std::sin(theta), cosine = std::cos(theta);
  const Double3 m = normalize(Double3{stretch_u * sine * std::cos(2 * pi * v),
                                      stretch_v * sine * std::sin(2 * pi * v), cosine});
  jacobian = sine * alpha_ * range_ * std::cosh(u * range_) * 2 * pi * stretch_u * stretch_v *
             std::pow(m.z / cosine, 3);
  return m;
}

Chart::Point FacetChart::at(double u, double v) const {
  const bool two_sided = below_ != Below::kNothing;
  const bool far = two_sided && u >= 0.5;
  const double within = !two_sided ? u : 2 * u - (far ? 1 : 0);
  double jacobian = 0;
  const Double3 m = normal_at(within, v, jacobian);
  if (two_sided) jacobian *= 2;
  const double cos_o = dot(wo_, m);
  if (far && below_ == Below::kRefracted) {
    const double cos2_i = 1 - (1 - cos_o * cos_o) / (eta_ * eta_);
    const double cos_i = std::sqrt(std::max(0.0, cos2_i));
    const Double3 wi = m * (cos_o / eta_ - cos_i) - wo_ * (1 / eta_);
    // Walter et al. 2007, eq. 17.
    const double per_normal =
        std::pow(cos_o - eta_ * cos_i, 2) / (eta_ * eta_ * std::max(cos_i, 1e-12));
    const bool exists = cos_o > 0 && cos2_i > 0;
    return {{wi.x, wi.y, wi.z * side_}, exists ? jacobian * per_normal : 0};
  }
  const Double3 wi = m * (2 * cos_o) - wo_;
  const double up = far ? -side_ : side_;
  // Half vectors face up, so each names the mirror direction above the plane through wo once.
  return {{wi.x, wi.y, wi.z * up}, jacobian * 4 * std::fabs(cos_o)};
}

std::pair<double, double> FacetChart::locate(Double3 wi) const {
  wi.z *= side_;
  const bool two_sided = below_ != Below::kNothing;
  const bool far = two_sided && wi.z < 0;
  Double3 m = wo_ + wi;
  if (far && below_ == Below::kRefracted) m = (wo_ + wi * eta_) * -1;
  if (far && below_ == Below::kMirrored) m = wo_ + Double3{wi.x, wi.y, -wi.z};
  if (m.z < 0) m = m * -1;
  const double p = m.x / alpha_u_ * alpha_, q = m.y / alpha_v_ * alpha_;
  const double theta = std::atan2(std::hypot(p, q), m.z);
  const double u = std::asinh(theta / alpha_) / range_;
  const double v = metrofarm::test::turns(p, q);
  if (!two_sided) return {u, v};
  return {0.5 * std::min(u, 1 - 1e-9) + (far ? 0.5 : 0), v};
}

}  // namespace metrofarm::bsdf::test
