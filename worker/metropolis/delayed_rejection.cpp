#include "metropolis/delayed_rejection.h"

#include <string>

namespace metrofarm::metropolis {
namespace {

std::optional<Error> problem_with_kernel(const Kernel& k) {
  if (!(k.large_step_probability > 0 && k.large_step_probability <= 1))
    return Error{"kernel.large_step_probability must lie in (0, 1]"};
  const double eye = k.eye_step_probability, light = k.light_step_probability;
  if (!(eye >= 0 && light >= 0 && k.large_step_probability + eye + light <= 1))
    return Error{
        "kernel.eye_step_probability and light_step_probability must not be negative, nor their "
        "sum with large_step_probability above 1"};
  switch (k.kind) {
    case KernelKind::kGaussian:
      if (!(k.sigma > 0 && k.sigma < 0.25)) return Error{"kernel.sigma must lie in (0, 0.25)"};
      return std::nullopt;
    case KernelKind::kWrappedCauchy:
      if (!(k.scale > 0 && k.scale < 0.25)) return Error{"kernel.scale must lie in (0, 0.25)"};
      return std::nullopt;
    case KernelKind::kUniform:
      if (!(k.half_width > 0 && k.half_width < 0.5))
        return Error{"kernel.half_width must lie in (0, 0.5)"};
      return std::nullopt;
    case KernelKind::kKelemenPair:
    case KernelKind::kKelemenCoordinate:
      break;
  }
  if (!(k.s1 > 0 && k.s1 < k.s2 && k.s2 < 0.5))
    return Error{"kernel radii must satisfy 0 < s1 < s2 < 0.5"};
  return std::nullopt;
}

const char* name_of(KernelKind kind) {
  switch (kind) {
    case KernelKind::kKelemenPair:
      return "kelemen_pair";
    case KernelKind::kGaussian:
      return "gaussian";
    case KernelKind::kKelemenCoordinate:
      return "kelemen_coordinate";
    case KernelKind::kWrappedCauchy:
      return "wrapped_cauchy";
    case KernelKind::kUniform:
      return "uniform";
  }
  return "";
}

std::optional<Error> problem_with_sizes(const DelayedRejection& d) {
  const double c = d.concentration;
  if (d.angle_law == AngleLaw::kWrappedCauchy && !(c >= 0 && c < 1))
    return Error{"delayed_rejection.concentration must lie in [0, 1) for wrapped_cauchy"};
  if (d.angle_law == AngleLaw::kVonMises && !(c >= 0 && c <= 10000))
    return Error{"delayed_rejection.concentration must lie in [0, 10000] for von_mises"};
  if (!(d.local_scale > 0 && d.local_scale <= 1))
    return Error{"delayed_rejection.local_scale must lie in (0, 1]"};
  return std::nullopt;
}

std::optional<Error> problem_with_combination(KernelKind kernel, const DelayedRejection& d) {
  if (d.move == SecondMove::kOrbital && d.rule == AcceptanceRule::kGreenMira)
    return Error{
        "delayed_rejection: an orbital move depends on the rejected proposal, so acceptance rule "
        "green_mira does not hold for it; use orbital or tierney_mira, or a local move"};
  if (d.move == SecondMove::kLocal && d.rule == AcceptanceRule::kOrbital)
    return Error{
        "delayed_rejection: after a local move the first stage's density does not cancel, which "
        "acceptance rule orbital needs; use tierney_mira or green_mira, or an orbital move"};
  if (d.move == SecondMove::kOrbital && d.rule == AcceptanceRule::kOrbital && !is_isotropic(kernel))
    return Error{std::string("delayed_rejection: kernel ") + name_of(kernel) +
                 " is not isotropic in a pair, so its density does not cancel along an orbit and "
                 "acceptance rule orbital would break detailed balance; use tierney_mira, or "
                 "kernel kelemen_pair or gaussian"};
  return std::nullopt;
}

}  // namespace

std::optional<Error> problem_with(const Proposals& p) {
  if (auto problem = problem_with_kernel(p.kernel)) return problem;
  if (!p.delayed_rejection.enabled()) return std::nullopt;
  if (auto problem = problem_with_sizes(p.delayed_rejection)) return problem;
  return problem_with_combination(p.kernel.kind, p.delayed_rejection);
}

}  // namespace metrofarm::metropolis
