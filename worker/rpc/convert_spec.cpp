#include <algorithm>

#include "rpc/convert.h"

namespace metrofarm::rpc {

using job::v1::ResolvedSpec;
using work_unit::Spec;

namespace {

Error unknown(const char* field) {
  return {std::string("spec.") + field + " is not one that this worker knows"};
}

Result<work_unit::Integrator> to_integrator(job::v1::Integrator integrator) {
  switch (integrator) {
    case job::v1::INTEGRATOR_PATH:
      return work_unit::Integrator::kPath;
    case job::v1::INTEGRATOR_PSSMLT:
      return work_unit::Integrator::kPssmlt;
    case job::v1::INTEGRATOR_BDPT:
      return work_unit::Integrator::kBdpt;
    case job::v1::INTEGRATOR_MMLT:
      return work_unit::Integrator::kMmlt;
    default:
      return unknown("integrator");
  }
}

Result<transport::LightSampling> to_light_sampling(job::v1::LightSampling sampling) {
  switch (sampling) {
    case job::v1::LIGHT_SAMPLING_MIS:
      return transport::LightSampling::kMis;
    case job::v1::LIGHT_SAMPLING_EMITTER:
      return transport::LightSampling::kEmitter;
    case job::v1::LIGHT_SAMPLING_BSDF:
      return transport::LightSampling::kBsdf;
    default:
      return unknown("light_sampling");
  }
}

Result<metropolis::KernelKind> to_kernel_kind(job::v1::KernelKind kind) {
  switch (kind) {
    case job::v1::KERNEL_KIND_KELEMEN_PAIR:
      return metropolis::KernelKind::kKelemenPair;
    case job::v1::KERNEL_KIND_GAUSSIAN:
      return metropolis::KernelKind::kGaussian;
    case job::v1::KERNEL_KIND_KELEMEN_COORDINATE:
      return metropolis::KernelKind::kKelemenCoordinate;
    case job::v1::KERNEL_KIND_WRAPPED_CAUCHY:
      return metropolis::KernelKind::kWrappedCauchy;
    case job::v1::KERNEL_KIND_UNIFORM:
      return metropolis::KernelKind::kUniform;
    default:
      return unknown("kernel.kind");
  }
}

}  // namespace

Result<metropolis::Kernel> to_kernel(const job::v1::Kernel& k) {
  const auto kind = to_kernel_kind(k.kind());
  if (!kind) return kind.error();
  metropolis::Kernel kernel;
  kernel.kind = kind.value();
  kernel.s1 = k.s1();
  kernel.s2 = k.s2();
  kernel.sigma = k.sigma();
  kernel.scale = k.scale();
  kernel.half_width = k.half_width();
  kernel.large_step_probability = k.large_step_probability();
  kernel.eye_step_probability = k.eye_step_probability();
  kernel.light_step_probability = k.light_step_probability();
  return kernel;
}

namespace {

Result<metropolis::AcceptanceRule> to_acceptance_rule(job::v1::AcceptanceRule rule) {
  switch (rule) {
    case job::v1::ACCEPTANCE_RULE_ORBITAL:
      return metropolis::AcceptanceRule::kOrbital;
    case job::v1::ACCEPTANCE_RULE_TIERNEY_MIRA:
      return metropolis::AcceptanceRule::kTierneyMira;
    case job::v1::ACCEPTANCE_RULE_GREEN_MIRA:
      return metropolis::AcceptanceRule::kGreenMira;
    default:
      return unknown("delayed_rejection.acceptance_rule");
  }
}

Result<metropolis::DelayedRejection> to_delayed_rejection(const job::v1::DelayedRejection& d) {
  metropolis::DelayedRejection out;
  if (!d.enabled()) return out;
  const auto rule = to_acceptance_rule(d.acceptance_rule());
  if (!rule) return rule.error();
  out.rule = rule.value();
  out.after_large_steps = d.after_large_steps();
  out.local_scale = d.local_scale();
  if (d.move() == job::v1::SECOND_MOVE_LOCAL) {
    out.move = metropolis::SecondMove::kLocal;
    return out;
  }
  if (d.move() != job::v1::SECOND_MOVE_ORBITAL) return unknown("delayed_rejection.move");
  out.move = metropolis::SecondMove::kOrbital;
  if (d.angle_law() == job::v1::ANGLE_LAW_VON_MISES) {
    out.angle_law = metropolis::AngleLaw::kVonMises;
  } else if (d.angle_law() != job::v1::ANGLE_LAW_WRAPPED_CAUCHY) {
    return unknown("delayed_rejection.angle_law");
  }
  out.concentration = d.concentration();
  return out;
}

// What only chains have; fails with the field at fault.
Result<Spec> with_chains(const ResolvedSpec& s, Spec spec) {
  const auto kernel = to_kernel(s.kernel());
  if (!kernel) return kernel.error();
  spec.kernel = kernel.value();
  const auto delayed_rejection = to_delayed_rejection(s.delayed_rejection());
  if (!delayed_rejection) return delayed_rejection.error();
  spec.delayed_rejection = delayed_rejection.value();
  spec.direct_apart = s.direct_sizes_size() > 0;
  spec.chain_groups = s.chain_groups();
  spec.target_map.side = static_cast<int>(std::min(s.target_map().side(), 1U << 20));
  spec.target_map.values.assign(s.target_map().values().begin(), s.target_map().values().end());
  for (const int layer : s.layers()) {
    if (layer != job::v1::DIAGNOSTIC_LAYER_ACCEPTANCE &&
        layer != job::v1::DIAGNOSTIC_LAYER_TECHNIQUES)
      return unknown("layers");
    spec.acceptance_layer |= layer == job::v1::DIAGNOSTIC_LAYER_ACCEPTANCE;
    spec.technique_layers |= layer == job::v1::DIAGNOSTIC_LAYER_TECHNIQUES;
  }
  if (s.layer_weights() == job::v1::LAYER_WEIGHTS_KELEMEN) {
    spec.layer_weights = metropolis::LayerWeights::kKelemen;
  } else if (s.layer_weights() != job::v1::LAYER_WEIGHTS_TWO_LAYER) {
    return unknown("layer_weights");
  }
  if (spec.integrator == work_unit::Integrator::kPssmlt) {
    if (s.under() != job::v1::UNDER_PATH && s.under() != job::v1::UNDER_BDPT)
      return unknown("under");
    if (s.under() == job::v1::UNDER_BDPT) spec.under = work_unit::Under::kBdpt;
    return spec;
  }
  if (s.technique_coordinate() == job::v1::TECHNIQUE_COORDINATE_MUTATED) {
    spec.technique_coordinate = work_unit::TechniqueCoordinate::kMutated;
  } else if (s.technique_coordinate() != job::v1::TECHNIQUE_COORDINATE_FROZEN) {
    return unknown("technique_coordinate");
  }
  spec.length_probabilities.assign(s.length_probabilities().begin(),
                                   s.length_probabilities().end());
  return spec;
}

Result<sensor::ShutterSettings> to_shutter(const ResolvedSpec& s,
                                           const metrofarm::scene::Sensor& sensor) {
  sensor::ShutterSettings shutter;
  shutter.open = s.has_shutter_open() ? s.shutter_open() : sensor.shutter_open;
  shutter.close = s.has_shutter_close() ? s.shutter_close() : sensor.shutter_close;
  if (s.shutter_curve() == job::v1::SHUTTER_CURVE_TRAPEZOID) {
    shutter.curve = sensor::ShutterCurve::kTrapezoid;
  } else if (s.shutter_curve() == job::v1::SHUTTER_CURVE_TABULATED) {
    shutter.curve = sensor::ShutterCurve::kTabulated;
  } else if (s.shutter_curve() != job::v1::SHUTTER_CURVE_BOX &&
             s.shutter_curve() != job::v1::SHUTTER_CURVE_UNSPECIFIED) {
    return unknown("shutter_curve");
  }
  shutter.samples.assign(s.shutter_samples().begin(), s.shutter_samples().end());
  shutter.ramp_open = s.shutter_ramp_open();
  shutter.ramp_close = s.shutter_ramp_close();
  if (s.exposure() == job::v1::EXPOSURE_CAMERA) {
    shutter.exposure = sensor::Exposure::kCamera;
  } else if (s.exposure() != job::v1::EXPOSURE_NORMALIZED &&
             s.exposure() != job::v1::EXPOSURE_UNSPECIFIED) {
    return unknown("exposure");
  }
  shutter.rolling = s.rolling_shutter();
  return shutter;
}

}  // namespace

Result<Spec> to_spec(const ResolvedSpec& s, const metrofarm::scene::SceneDescription& scene) {
  Spec spec;
  const auto integrator = to_integrator(s.integrator());
  if (!integrator) return integrator.error();
  spec.integrator = integrator.value();
  if (s.group_size() != work_unit::kGroupSize)
    return Error{"spec.group_size must be " + std::to_string(work_unit::kGroupSize)};
  const auto sampling = to_light_sampling(s.light_sampling());
  if (!sampling) return sampling.error();
  if (work_unit::runs_chains(spec.integrator)) {
    auto chains = with_chains(s, std::move(spec));
    if (!chains) return chains.error();
    spec = std::move(chains.value());
  }
  spec.path = {sampling.value(), s.max_depth(), s.rr_depth(), scene.integrator.hide_emitters};
  spec.width = static_cast<int>(std::min(s.width(), 1U << 20));
  spec.height = static_cast<int>(std::min(s.height(), 1U << 20));
  spec.seed = s.seed();
  spec.bootstrap_samples = s.bootstrap_samples();
  // Not known yet while the bootstrap runs, which does not need it.
  spec.unit = s.unit() == 0 ? 1 : s.unit();
  spec.blocks_per_segment = std::max(1U, s.blocks_per_segment());
  auto shutter = to_shutter(s, scene.sensor);
  if (!shutter) return shutter.error();
  spec.shutter = std::move(shutter.value());
  if (const std::string problem = work_unit::problem_with(spec); !problem.empty())
    return Error{"spec: " + problem};
  if (!film::Filter::fits(scene.film.filter_radius))
    return Error{"the film's filter is too wide for this worker", scene.film.where};
  return spec;
}

}  // namespace metrofarm::rpc
