package plan

import (
	"math"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

const (
	maxRounds         = 64
	chainGrowth       = 1.25
	pathGrowth        = 1.35
	minChainMutations = 16
	firstPathSamples  = 4
)

// requestedCount is what the rounds have to sum to: mutations per chain or samples per pixel; 0
// means no limit, which the other stop rules then have to set. Where the integrator was chosen
// automatically, either count is taken as the budget per pixel.
func requestedCount(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) uint64 {
	stop := r.Stop
	perPixel := stop.SamplesPerPixel
	if RunsChains(spec) {
		perPixel = stop.MutationsPerPixel
	}
	if perPixel == 0 {
		perPixel = max(stop.SamplesPerPixel, stop.MutationsPerPixel)
	}
	if perPixel == 0 && stop.TargetError == 0 && stop.TimeSeconds == 0 && stop.Rounds == 0 {
		perPixel = uint64(max(1, report.GetSampleCount()))
	}
	if !RunsChains(spec) {
		return perPixel
	}
	pixels, chains := uint64(spec.GetWidth())*uint64(spec.GetHeight()), uint64(Chains(spec))
	return ceilMulDiv(perPixel, pixels, chains)
}

// ceilMulDiv is a*b/c rounded up, without overflow for a up to 2^40 and b up to 2^26.
func ceilMulDiv(a, b, c uint64) uint64 {
	whole, rest := a/c, a%c
	return whole*b + (rest*b+c-1)/c
}

// roundSizes lists the rounds' sizes. Each is the geometric law rounded up, so that the list is the
// same on every machine; a limit cuts the last round short.
func roundSizes(spec *jobv1.ResolvedSpec, limit uint64) []uint64 {
	first, growth := uint64(firstPathSamples), pathGrowth
	if RunsChains(spec) {
		pixels, chains := uint64(spec.GetWidth())*uint64(spec.GetHeight()), uint64(Chains(spec))
		first, growth = max(minChainMutations, (pixels+chains-1)/chains), chainGrowth
	}
	var sizes []uint64
	var sum uint64
	for size := first; ; size = uint64(math.Ceil(float64(size) * growth)) {
		if limit > 0 && sum+size >= limit {
			return append(sizes, limit-sum)
		}
		if limit == 0 && len(sizes) == maxRounds {
			return sizes
		}
		sizes = append(sizes, size)
		sum += size
	}
}
