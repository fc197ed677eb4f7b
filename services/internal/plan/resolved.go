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
	maxChainGroups   = 1 << 14
	maxSpecRounds    = 4096
	maxSpecBootstrap = 1 << 24
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
	group := uint64(s.GetGroupSize())
	switch {
	case film.Shape{Width: int(s.GetWidth()), Height: int(s.GetHeight()), Layers: 1}.Validate() != nil,
		uint64(s.GetWidth())*uint64(s.GetHeight()) > maxPixels:
		return "width or height is out of range"
	case s.GetLightSampling() < 1 || s.GetLightSampling() > 3:
		return "light_sampling is missing"
	case s.GetMaxDepth() < -1 || s.GetMaxDepth() == 0 || s.GetRrDepth() < 1:
		return "max_depth or rr_depth is out of range"
	case group < 1 || group > 4096:
		return "group_size is outside 1..4096"
	case s.GetBootstrapSamples() == 0 || s.GetBootstrapSamples() > maxSpecBootstrap || s.GetBootstrapSamples()%(2*group) != 0:
		return "bootstrap_samples is not an even multiple of group_size"
	case !(s.GetUnit() > 0) || math.IsInf(s.GetUnit(), 0):
		return "unit is not positive and finite"
	case len(s.GetRoundSizes()) == 0 || len(s.GetRoundSizes()) > maxSpecRounds:
		return "round_sizes is empty or too long"
	}
	for _, size := range s.GetRoundSizes() {
		if size == 0 || size > 1<<48 {
			return "a round size is out of range"
		}
	}
	return checkIntegrator(s)
}

func checkIntegrator(s *jobv1.ResolvedSpec) string {
	switch s.GetIntegrator() {
	case jobv1.Integrator_INTEGRATOR_PATH:
		if s.GetBlocksPerSegment() == 0 || s.GetBlocksPerSegment() > 1<<20 {
			return "blocks_per_segment is out of range"
		}
		return ""
	case jobv1.Integrator_INTEGRATOR_PSSMLT:
		if s.GetChainGroups() == 0 || s.GetChainGroups()%groupMultiple != 0 || s.GetChainGroups() > maxChainGroups {
			return "chain_groups is not a positive multiple of 16"
		}
		return checkKernel(s.GetKernel())
	}
	return "integrator is missing"
}

func checkKernel(k *jobv1.Kernel) string {
	if p := k.GetLargeStepProbability(); !(p > 0 && p <= 1) {
		return "large_step_probability is outside 0 < p <= 1"
	}
	switch k.GetKind() {
	case jobv1.KernelKind_KERNEL_KIND_KELEMEN_PAIR:
		if !(k.GetS1() > 0 && k.GetS1() < k.GetS2() && k.GetS2() < 0.5) {
			return "kernel radii are not 0 < s1 < s2 < 0.5"
		}
	case jobv1.KernelKind_KERNEL_KIND_GAUSSIAN:
		if !(k.GetSigma() > 0 && k.GetSigma() < 0.25) {
			return "sigma is outside 0 < sigma < 0.25"
		}
	default:
		return "kernel kind is missing"
	}
	return ""
}
