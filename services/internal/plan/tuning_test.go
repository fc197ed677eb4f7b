package plan

import (
	"testing"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

func TestTrialsStayWithinKernels(t *testing.T) {
	for _, name := range []string{"kelemen", "kelemen-coordinate", "gaussian", "wrapped-cauchy", "uniform"} {
		spec := &jobv1.ResolvedSpec{Kernel: kernel(job.Request{Kernel: name})}
		kernels, factors := TrialKernels(spec)
		if len(kernels) != len(trialFactors) || len(factors) != len(kernels) {
			t.Errorf("%s: %d trials", name, len(kernels))
		}
		wide := kernel(job.Request{Kernel: "gaussian", Sigma: 0.2})
		kernels, _ = TrialKernels(&jobv1.ResolvedSpec{Kernel: wide})
		if len(kernels) != 5 {
			t.Errorf("sigma 0.2: %d trials", len(kernels))
		}
	}
}

func TestTheKernelClosestToTheWantedAcceptance(t *testing.T) {
	for _, c := range []struct {
		accepted []uint64 // of 1000
		want     float64
	}{
		{[]uint64{950, 900, 800, 650, 390, 100, 20}, 1},
		{[]uint64{300, 200, 100, 50, 20, 10, 0}, 1.0 / 16},
		{[]uint64{1000, 1000, 1000, 1000, 1000, 1000, 1000}, 4}, // all alike: the largest
		{[]uint64{0, 0, 0, 0, 0, 0, 0}, 4},
	} {
		spec := &jobv1.ResolvedSpec{Kernel: kernel(job.Request{})}
		var trials []*farmv1.SegmentCounts
		for _, n := range c.accepted {
			trials = append(trials, &farmv1.SegmentCounts{SmallSteps: 1000, SmallAccepted: n})
		}
		SetKernel(spec, trials)
		if spec.Kernel.S2 != job.KelemenS2*c.want || spec.Kernel.S1 != job.KelemenS1*c.want {
			t.Errorf("%v: factor %v, not %v", c.accepted, spec.Kernel.S2/job.KelemenS2, c.want)
		}
		if len(spec.KernelTuning.Acceptances) != 7 || spec.KernelTuning.Reason == "" {
			t.Errorf("%v", spec.KernelTuning)
		}
	}
}
