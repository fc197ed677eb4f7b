package plan

import (
	"fmt"
	"math"

	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

const (
	// TrialMutations of each chain under each kernel.
	TrialMutations = 512
	// wantedAcceptance of small steps.
	wantedAcceptance = 0.4
)

// trialFactors of the lengths of the kernel that was asked for.
var trialFactors = []float64{1.0 / 16, 1.0 / 8, 1.0 / 4, 1.0 / 2, 1, 2, 4}

// NeedsTrials tells whether kernels have to be tried.
func NeedsTrials(spec *jobv1.ResolvedSpec, r job.Request) bool {
	return RunsChains(spec) && r.KernelTuning == job.On && r.Resolved == "" && spec.GetKernelTuning() == nil
}

// TrialKernels are what to try: the kernel's lengths multiplied by factors, as far as they stay
// within what kernels may be.
func TrialKernels(spec *jobv1.ResolvedSpec) (kernels []*jobv1.Kernel, factors []float64) {
	for _, factor := range trialFactors {
		k := scaled(spec.GetKernel(), factor)
		if checkKernel(k) == "" {
			kernels, factors = append(kernels, k), append(factors, factor)
		}
	}
	return kernels, factors
}

func scaled(kernel *jobv1.Kernel, factor float64) *jobv1.Kernel {
	k := proto.CloneOf(kernel)
	k.S1, k.S2, k.Sigma = k.S1*factor, k.S2*factor, k.Sigma*factor
	k.Scale, k.HalfWidth = k.Scale*factor, k.HalfWidth*factor
	return k
}

// SetKernel chooses the trial whose small steps were accepted closest to wantedAcceptance, on the
// scale of odds; of two alike the larger. Requires: counts of as many trials as TrialKernels has.
func SetKernel(spec *jobv1.ResolvedSpec, trials []*farmv1.SegmentCounts) {
	kernels, factors := TrialKernels(spec)
	tuning := &jobv1.KernelTuning{Factors: factors}
	best, smallest := 0, math.Inf(1)
	for i, t := range trials {
		// Never 0 nor 1, so that the odds are finite.
		share := (float64(t.GetSmallAccepted()) + 0.5) / (float64(t.GetSmallSteps()) + 1)
		tuning.Acceptances = append(tuning.Acceptances, share)
		distance := math.Abs(logit(share) - logit(wantedAcceptance))
		if distance <= smallest {
			best, smallest = i, distance
		}
	}
	tuning.Reason = fmt.Sprintf("small steps of %.4g times the kernel's size are accepted in %.0f %%, closest to %.0f %%",
		factors[best], 100*tuning.Acceptances[best], 100*wantedAcceptance)
	spec.Kernel, spec.KernelTuning = kernels[best], tuning
}

func logit(p float64) float64 { return math.Log(p / (1 - p)) }
