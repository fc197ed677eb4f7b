package plan

import (
	"fmt"
	"math"

	"google.golang.org/protobuf/encoding/protojson"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

// Limits on specs that come from outside.
const (
	// maxSpecBytes of a spec's text: the largest target map takes a quarter of it.
	maxSpecBytes     = 256 << 10
	maxChainGroups   = 1 << 14
	maxSpecRounds    = 4096
	maxSpecBootstrap = 1 << 24
	// minUnit and maxUnit are about what scenes can give: radiance is a float32, and the unit of plain
	// samples a multiple of its mean. Squares of what is measured in such units are finite in float64.
	minUnit = 1e-38
	maxUnit = 1e45
)

// FormatResolved renders a spec as Request.Resolved takes it.
func FormatResolved(spec *jobv1.ResolvedSpec) (string, error) {
	text, err := protojson.Marshal(spec)
	if err != nil {
		return "", fmt.Errorf("plan: format spec: %w", err)
	}
	return string(text), nil
}

// ParseResolved reads the spec of an earlier job and checks it. Errors are *job.FieldError.
func ParseResolved(text string) (*jobv1.ResolvedSpec, error) {
	if len(text) > maxSpecBytes {
		return nil, &job.FieldError{Field: "resolved", Detail: fmt.Sprintf("has %d bytes; a spec has at most %d", len(text), maxSpecBytes)}
	}
	spec := &jobv1.ResolvedSpec{}
	if err := protojson.Unmarshal([]byte(text), spec); err != nil {
		return nil, &job.FieldError{Field: "resolved", Detail: err.Error()}
	}
	if detail := checkSpec(spec); detail != "" {
		return nil, &job.FieldError{Field: "resolved", Detail: detail}
	}
	return spec, nil
}

// checkSpec says what is wrong with a complete spec, "" if nothing is.
func checkSpec(s *jobv1.ResolvedSpec) string {
	switch {
	case film.Shape{Width: int(s.GetWidth()), Height: int(s.GetHeight()), Layers: 1}.Validate() != nil,
		uint64(s.GetWidth())*uint64(s.GetHeight()) > maxPixels:
		return "width or height is out of range"
	case s.GetLightSampling() < 1 || s.GetLightSampling() > 3:
		return "light_sampling is missing"
	case Bidirectional(s) && s.GetLightSampling() != jobv1.LightSampling_LIGHT_SAMPLING_MIS:
		return "light_sampling is not mis, but bidirectional tracing has every technique"
	case s.GetMaxDepth() < -1 || s.GetMaxDepth() == 0 || s.GetRrDepth() < 1:
		return "max_depth or rr_depth is out of range"
	case Multiplexed(s) && (s.GetMaxDepth() < 1 || s.GetMaxDepth() > LongestMultiplexed):
		return "max_depth is outside 1..32, which mmlt takes"
	case s.GetGroupSize() != GroupSize:
		return fmt.Sprintf("group_size is %d; workers have groups of %d", s.GetGroupSize(), GroupSize)
	case s.GetBootstrapSamples() == 0 || s.GetBootstrapSamples() > maxSpecBootstrap || s.GetBootstrapSamples()%(film.Halves*GroupSize) != 0:
		return "bootstrap_samples is not an even multiple of group_size"
	case !(s.GetUnit() >= minUnit && s.GetUnit() <= maxUnit):
		return fmt.Sprintf("unit is %v, outside %v..%v", s.GetUnit(), minUnit, maxUnit)
	case len(s.GetRoundSizes()) == 0 || len(s.GetRoundSizes()) > maxSpecRounds:
		return "round_sizes is empty or too long"
	}
	for _, size := range s.GetRoundSizes() {
		if size == 0 || size > 1<<48 {
			return "a round size is out of range"
		}
	}
	if detail := checkIntegrator(s); detail != "" {
		return detail
	}
	return checkWork(s)
}

func checkIntegrator(s *jobv1.ResolvedSpec) string {
	if !RunsChains(s) && (DirectApart(s) || s.GetTargetMap() != nil) {
		return "direct_sizes and target_map belong to chains"
	}
	for _, detail := range []string{checkLayers(s), checkShutter(s)} {
		if detail != "" {
			return detail
		}
	}
	if s.GetUnder() != 0 && s.GetIntegrator() != jobv1.Integrator_INTEGRATOR_PSSMLT {
		return "under belongs to INTEGRATOR_PSSMLT"
	}
	switch {
	case RunsChains(s):
		return checkChains(s)
	case IntegratorName(s) == "":
		return "integrator is missing"
	case s.GetBlocksPerSegment() == 0 || s.GetBlocksPerSegment() > 1<<20:
		return "blocks_per_segment is out of range"
	}
	return ""
}

func checkChains(s *jobv1.ResolvedSpec) string {
	switch {
	case s.GetChainGroups() == 0 || s.GetChainGroups()%groupMultiple != 0 || s.GetChainGroups() > maxChainGroups:
		return "chain_groups is not a positive multiple of 16"
	case s.GetLayerWeights() < 1 || s.GetLayerWeights() > 2:
		return "layer_weights is missing"
	}
	for _, detail := range []string{
		checkKernel(s.GetKernel()), checkSecondStage(s.GetDelayedRejection(), s.GetKernel().GetKind()), checkTarget(s),
		checkDirect(s), checkMap(s.GetTargetMap()),
	} {
		if detail != "" {
			return detail
		}
	}
	return ""
}

// checkTarget looks at what the chains run over.
func checkTarget(s *jobv1.ResolvedSpec) string {
	k := s.GetKernel()
	if !Bidirectional(s) && (k.GetEyeStepProbability() > 0 || k.GetLightStepProbability() > 0) {
		return "eye_step_probability and light_step_probability belong to chains with light subpaths"
	}
	if !Multiplexed(s) {
		if s.GetUnder() < 1 || s.GetUnder() > 2 {
			return "under is missing"
		}
		return ""
	}
	sum := 0.0
	for _, p := range s.GetLengthProbabilities() {
		if !(p >= 0) {
			return "length_probabilities has a value that is not positive"
		}
		sum += p
	}
	switch {
	case s.GetTechniqueCoordinate() < 1 || s.GetTechniqueCoordinate() > 2:
		return "technique_coordinate is missing"
	case s.GetBootstrapSamples()%bootstrapMultiple(s) != 0:
		return "bootstrap_samples is not a multiple of 16 max_depth"
	case len(s.GetLengthProbabilities()) != int(s.GetMaxDepth()):
		return "length_probabilities does not have max_depth values"
	case !(math.Abs(sum-1) <= 1e-9):
		return "length_probabilities does not sum to 1"
	}
	return ""
}

func checkKernel(k *jobv1.Kernel) string {
	if p := k.GetLargeStepProbability(); !(p > 0 && p <= 1) {
		return "large_step_probability is outside 0 < p <= 1"
	}
	if eye, light := k.GetEyeStepProbability(), k.GetLightStepProbability(); !(eye >= 0 && light >= 0 && k.GetLargeStepProbability()+eye+light <= 1) {
		return "eye_step_probability or light_step_probability is negative, or all steps sum to more than 1"
	}
	switch k.GetKind() {
	case jobv1.KernelKind_KERNEL_KIND_KELEMEN_PAIR, jobv1.KernelKind_KERNEL_KIND_KELEMEN_COORDINATE:
		if !(k.GetS1() > 0 && k.GetS1() < k.GetS2() && k.GetS2() < 0.5) {
			return "kernel radii are not 0 < s1 < s2 < 0.5"
		}
	case jobv1.KernelKind_KERNEL_KIND_GAUSSIAN:
		if !(k.GetSigma() > 0 && k.GetSigma() < 0.25) {
			return "sigma is outside 0 < sigma < 0.25"
		}
	case jobv1.KernelKind_KERNEL_KIND_WRAPPED_CAUCHY:
		if !(k.GetScale() > 0 && k.GetScale() < 0.25) {
			return "scale is outside 0 < scale < 0.25"
		}
	case jobv1.KernelKind_KERNEL_KIND_UNIFORM:
		if !(k.GetHalfWidth() > 0 && k.GetHalfWidth() < 0.5) {
			return "half_width is outside 0 < half_width < 0.5"
		}
	default:
		return "kernel kind is missing"
	}
	return ""
}

func checkSecondStage(d *jobv1.DelayedRejection, kernel jobv1.KernelKind) string {
	orbital := d.GetMove() == jobv1.SecondMove_SECOND_MOVE_ORBITAL
	concentration := d.GetConcentration()
	switch {
	case !d.GetEnabled():
		return ""
	case d.GetMove() < 1 || d.GetMove() > 2:
		return "delayed_rejection.move is missing"
	case d.GetAcceptanceRule() < 1 || d.GetAcceptanceRule() > 3:
		return "acceptance_rule is missing"
	case !(d.GetLocalScale() > 0 && d.GetLocalScale() <= 1):
		return "local_scale is outside 0 < local_scale <= 1"
	case orbital && (d.GetAngleLaw() < 1 || d.GetAngleLaw() > 2):
		return "angle_law is missing"
	case d.GetAngleLaw() == jobv1.AngleLaw_ANGLE_LAW_VON_MISES && !(concentration >= 0 && concentration <= job.MaxKappa):
		return "concentration is outside 0 <= kappa <= 10000"
	case d.GetAngleLaw() == jobv1.AngleLaw_ANGLE_LAW_WRAPPED_CAUCHY && !(concentration >= 0 && concentration < 1):
		return "concentration is outside 0 <= rho < 1"
	}
	return checkBalance(d.GetAcceptanceRule(), orbital, kernel)
}

// checkBalance refuses acceptance rules that would bias the image.
func checkBalance(rule jobv1.AcceptanceRule, orbital bool, kernel jobv1.KernelKind) string {
	isotropic := kernel == jobv1.KernelKind_KERNEL_KIND_KELEMEN_PAIR || kernel == jobv1.KernelKind_KERNEL_KIND_GAUSSIAN
	switch {
	case rule == jobv1.AcceptanceRule_ACCEPTANCE_RULE_ORBITAL && !orbital:
		return "acceptance_rule ORBITAL would bias the image after a local move: use TIERNEY_MIRA or GREEN_MIRA"
	case rule == jobv1.AcceptanceRule_ACCEPTANCE_RULE_ORBITAL && !isotropic:
		return "acceptance_rule ORBITAL would bias the image after a kernel that is not isotropic in a pair: " +
			"use TIERNEY_MIRA, or kernel KELEMEN_PAIR or GAUSSIAN"
	case rule == jobv1.AcceptanceRule_ACCEPTANCE_RULE_GREEN_MIRA && orbital:
		return "acceptance_rule GREEN_MIRA would bias the image where the move depends on the rejected proposal: " +
			"use ORBITAL or TIERNEY_MIRA, or move LOCAL"
	}
	return ""
}
