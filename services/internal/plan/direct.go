package plan

import (
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

const (
	// DirectUnit is the unit of the layer of direct light, in film units: lamps that are seen
	// directly are far brighter than what chains look for.
	DirectUnit = 4096
	// longestDirect is the number of edges of the longest path of direct light.
	longestDirect = 2
	// directShare is the number of direct samples per mutation.
	directShare = 0.25
)

// DirectApart tells whether independent paths carry the light that bounces at most once.
func DirectApart(spec *jobv1.ResolvedSpec) bool { return len(spec.GetDirectSizes()) > 0 }

// wantsDirectApart says so of a request, and why not where it cannot be done.
func wantsDirectApart(spec *jobv1.ResolvedSpec, r job.Request) (apart bool, warning string) {
	if r.DirectApart != job.On {
		return false, ""
	}
	if depth := spec.GetMaxDepth(); depth >= 0 && depth <= longestDirect {
		return false, "direct_apart is off: max_depth leaves the chains nothing else"
	}
	return true, ""
}

// directSizes adds a quarter of a sample per mutation, in whole pairs, so that both halves of the
// film have equally many, and at least one pair at once.
func directSizes(spec *jobv1.ResolvedSpec) []uint64 {
	pixels, chains := uint64(spec.GetWidth())*uint64(spec.GetHeight()), uint64(Chains(spec))
	sizes := make([]uint64, len(spec.GetRoundSizes()))
	var mutations, before uint64
	for i, size := range spec.GetRoundSizes() {
		mutations += size
		perPixel := float64(mutations) * float64(chains) / float64(pixels)
		total := 2 * max(1, uint64(perPixel*directShare/2))
		sizes[i] = max(total, before) - before
		before += sizes[i]
	}
	return sizes
}

// checkDirect says what is wrong with the direct sizes of a complete spec, "" if nothing is.
func checkDirect(s *jobv1.ResolvedSpec) string {
	if !DirectApart(s) {
		return ""
	}
	depth := s.GetMaxDepth()
	switch {
	case len(s.GetDirectSizes()) != len(s.GetRoundSizes()):
		return "direct_sizes are not as many as round_sizes"
	case s.GetDirectSizes()[0] == 0:
		return "direct_sizes begin with 0"
	case depth >= 0 && depth <= longestDirect:
		return "direct_sizes are given, but max_depth leaves the chains nothing else"
	}
	for _, size := range s.GetDirectSizes() {
		if size%2 != 0 || size > 1<<48 {
			return "a direct size is odd or out of range"
		}
	}
	return ""
}
