package plan

import (
	"math"

	"google.golang.org/protobuf/proto"

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
	// CutMultiple: workers bring what chains have gathered into the film whenever each has made so many
	// mutations (kDealInterval of worker/work_unit), and at the end of a round. A round that a stop rule
	// cuts short there can be gone on with as if it had not been, to the same bits.
	CutMultiple = 16
)

// requestedCount is what the rounds have to sum to: mutations per chain or samples per pixel; 0
// means no limit, which the other stop rules then have to set.
func requestedCount(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) uint64 {
	perPixel := requestedPerPixel(spec, r, report)
	if !RunsChains(spec) {
		return perPixel
	}
	pixels, chains := uint64(spec.GetWidth())*uint64(spec.GetHeight()), uint64(Chains(spec))
	return ceilMulDiv(perPixel, pixels, chains)
}

// requestedPerPixel is how many mutations or samples per pixel are asked for; 0: as many as the other
// stop rules let. Where the integrator was chosen automatically, either count is taken.
func requestedPerPixel(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) uint64 {
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
	return perPixel
}

// ceilMulDiv is a*b/c rounded up, without overflow for a up to 2^40 and b up to 2^26.
func ceilMulDiv(a, b, c uint64) uint64 {
	whole, rest := a/c, a%c
	return whole*b + (rest*b+c-1)/c
}

// roundSizes lists the rounds' sizes. Each is the geometric law rounded up, so that the list is the
// same on every machine; a limit cuts the last round short, for chains on a multiple of CutMultiple.
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
			last := limit - sum
			if RunsChains(spec) {
				last = min(size, roundUp(limit, CutMultiple)-sum)
			}
			return append(sizes, last)
		}
		if limit == 0 && len(sizes) == maxRounds {
			return sizes
		}
		sizes = append(sizes, size)
		sum += size
	}
}

// Extend returns the spec that a job with the request has where another request, which differed from
// it in its stop rules alone, led to spec.
func Extend(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) *jobv1.ResolvedSpec {
	if r.Resolved != "" {
		return spec // its rounds are those that it was submitted with
	}
	extended := proto.CloneOf(spec)
	extended.RoundSizes = roundSizes(extended, requestedCount(extended, r, report))
	if DirectApart(spec) {
		extended.DirectSizes = directSizes(extended)
	}
	return extended
}
