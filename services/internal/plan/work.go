package plan

import (
	"fmt"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

// Limits on the work that a spec from outside asks for. What Resolve makes stays far below them.
const (
	// maxSegments of a round, each of which has a task in the coordinator.
	maxSegments = maxChainGroups
	// maxFirstWork is how many mutations or samples a segment of the first round may have: no stop rule
	// ends a job before that round does. Resolve asks for 2^22 at most, from which chains on the largest
	// image begin.
	maxFirstWork = 1 << 30
	// maxGrowth is how often a round may have the size of all rounds before it together, so that a job
	// that runs out of time, whose round under way is the last, ends within about three times as much. The
	// rounds of Resolve have at most 1.35 times the size of the one before, rounded up.
	maxGrowth = 2
	// maxCounted is the largest count per pixel that ceilMulDiv takes.
	maxCounted = 1 << 40
	// widestBorder of a film: the radius of the widest filter, see SceneReport.filter_radius, rounded up.
	widestBorder = 20
)

// checkWork says what is too much in the rounds of a spec that is complete and sound otherwise, "" if
// nothing is.
func checkWork(s *jobv1.ResolvedSpec) string {
	cells := (int(s.GetWidth()) + 2*widestBorder) * (int(s.GetHeight()) + 2*widestBorder)
	if segments := Segments(s, cells); segments > maxSegments {
		return fmt.Sprintf("blocks_per_segment is %d, which makes up to %d segments; a round has at most %d",
			s.GetBlocksPerSegment(), segments, maxSegments)
	}
	perSegment := uint64(GroupSize)
	if !RunsChains(s) {
		perSegment = uint64(min(CellsPerSegment(s), cells))
	}
	sizes := s.GetRoundSizes()
	if sizes[0] > maxFirstWork/perSegment {
		return fmt.Sprintf("round_sizes begin with %d, of which each segment has %d: a segment of the first round has at most "+
			"%d mutations or samples", sizes[0], perSegment, maxFirstWork)
	}
	before := sizes[0]
	for i, size := range sizes[1:] {
		if size > maxGrowth*before {
			return fmt.Sprintf("round_sizes has %d for round %d: a round is at most %d times as large as those before it together, %d",
				size, i+1, maxGrowth, before)
		}
		before += size
	}
	return checkDirectWork(s)
}

// checkDirectWork compares the samples of direct light apart with the mutations, of which Resolve makes
// four times as many.
func checkDirectWork(s *jobv1.ResolvedSpec) string {
	perSize := PerPixel(s)
	var mutations, direct float64
	for i, size := range s.GetDirectSizes() {
		mutations += float64(s.GetRoundSizes()[i]) * perSize
		direct += float64(size)
		if direct > max(2, mutations) {
			return fmt.Sprintf("direct_sizes ask for %.0f samples per cell up to round %d: at most as many as mutations per pixel, %.1f, "+
				"or 2", direct, i, mutations)
		}
	}
	return ""
}

// PerPixel is what one unit of a round's size amounts to per pixel.
func PerPixel(s *jobv1.ResolvedSpec) float64 {
	if !RunsChains(s) {
		return 1
	}
	return float64(Chains(s)) / (float64(s.GetWidth()) * float64(s.GetHeight()))
}

// checkRounds looks at how far the rounds of a spec go that a field asks for, as far as counts end the job.
// Where time or an error is to end it, only the first round is certain. Errors are *job.FieldError.
func (l Limits) checkRounds(field string, spec *jobv1.ResolvedSpec, stop job.StopRules) error {
	if l.PerPixel == 0 {
		return nil
	}
	most := min(l.PerPixel, maxCounted)
	if RunsChains(spec) { // as roundSizes cuts them
		pixels := uint64(spec.GetWidth()) * uint64(spec.GetHeight())
		most = roundUp(ceilMulDiv(most, pixels, uint64(Chains(spec))), CutMultiple)
	}
	asked := certainSize(spec, stop)
	if asked <= most {
		return nil
	}
	return &job.FieldError{Field: field, Detail: fmt.Sprintf(
		"asks for rounds of %.1f mutations or samples per pixel; this server takes at most %d: ask for fewer with stop.rounds, "+
			"or repeat a smaller job", float64(asked)*PerPixel(spec), l.PerPixel)}
}

// certainSize is the size of the rounds that are rendered whatever the time takes and the errors are.
func certainSize(spec *jobv1.ResolvedSpec, stop job.StopRules) (sum uint64) {
	sizes := spec.GetRoundSizes()
	if stop.Rounds > 0 {
		sizes = sizes[:min(len(sizes), stop.Rounds)]
	}
	count := max(stop.SamplesPerPixel, stop.MutationsPerPixel)
	if count == 0 && (stop.TimeSeconds > 0 || stop.TargetError > 0) {
		return sizes[0]
	}
	for _, size := range sizes {
		sum += size
		if count > 0 && float64(sum)*PerPixel(spec) >= float64(count) {
			break
		}
	}
	return sum
}
