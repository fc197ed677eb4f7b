package plan

import (
	"math"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

const (
	// targetSegments keeps many workers busy within one round of a small film.
	targetSegments = 64
	// maxBlocksPerSegment bounds a segment of a large film to 65536 cells.
	maxBlocksPerSegment = 1024
	maxTaskSamples      = 65536
	bootstrapTasksHalf  = 8
)

// Border is the number of extra pixels on each side of the film from which light reaches it: none
// for a box, else the filter's radius rounded up.
func Border(report *scenev1.SceneReport) int {
	if report.GetFilter() == scenev1.Filter_FILTER_BOX && report.GetFilterRadius() == 0.5 {
		return 0
	}
	return int(math.Ceil(report.GetFilterRadius()))
}

// Cells is the number of film cells that are sampled: pixels and border.
func Cells(spec *jobv1.ResolvedSpec, report *scenev1.SceneReport) int {
	border := 2 * Border(report)
	return (int(spec.GetWidth()) + border) * (int(spec.GetHeight()) + border)
}

// RunsChains tells whether the samples are those of Markov chains, whose film has two layers and
// more; else they are independent.
func RunsChains(spec *jobv1.ResolvedSpec) bool {
	return spec.GetIntegrator() == jobv1.Integrator_INTEGRATOR_PSSMLT || Multiplexed(spec)
}

// Multiplexed tells whether each sample has one path length and one technique.
func Multiplexed(spec *jobv1.ResolvedSpec) bool {
	return spec.GetIntegrator() == jobv1.Integrator_INTEGRATOR_MMLT
}

// Bidirectional tells whether samples have a light subpath.
func Bidirectional(spec *jobv1.ResolvedSpec) bool {
	return spec.GetIntegrator() == jobv1.Integrator_INTEGRATOR_BDPT || Multiplexed(spec) ||
		spec.GetUnder() == jobv1.Under_UNDER_BDPT
}

// IntegratorName of a resolved spec, as requests have it.
func IntegratorName(spec *jobv1.ResolvedSpec) string {
	return map[jobv1.Integrator]string{
		jobv1.Integrator_INTEGRATOR_PATH:   job.IntegratorPath,
		jobv1.Integrator_INTEGRATOR_BDPT:   job.IntegratorBDPT,
		jobv1.Integrator_INTEGRATOR_PSSMLT: job.IntegratorPSSMLT,
		jobv1.Integrator_INTEGRATOR_MMLT:   job.IntegratorMMLT,
	}[spec.GetIntegrator()]
}

// Segments is the number of segments in a round over so many film cells, those of a dark half
// included.
func Segments(spec *jobv1.ResolvedSpec, cells int) int {
	if RunsChains(spec) {
		return int(spec.GetChainGroups())
	}
	perSegment := CellsPerSegment(spec)
	return (cells + perSegment - 1) / perSegment
}

// CellsPerSegment of independent samples; the last segment may have fewer.
func CellsPerSegment(spec *jobv1.ResolvedSpec) int {
	return int(spec.GetBlocksPerSegment()) * int(spec.GetGroupSize())
}

// Chains is the number of Markov chains; 0 without.
func Chains(spec *jobv1.ResolvedSpec) int {
	return int(spec.GetChainGroups()) * int(spec.GetGroupSize())
}

// Shape of the job's film.
func Shape(spec *jobv1.ResolvedSpec) film.Shape {
	return film.Shape{Width: int(spec.GetWidth()), Height: int(spec.GetHeight()), Layers: layers(spec)}
}

// Range is a run of bootstrap indices.
type Range struct {
	First uint64
	Count uint32
}

// BootstrapRanges cuts the bootstrap into tasks: each within one half, multiples of the group size,
// at most 65536 samples, at least eight per half where there are groups enough.
func BootstrapRanges(spec *jobv1.ResolvedSpec) []Range {
	group := uint64(spec.GetGroupSize())
	half := spec.GetBootstrapSamples() / film.Halves
	size := min(max(half/bootstrapTasksHalf/group*group, group), maxTaskSamples/group*group)
	var ranges []Range
	for h := range uint64(film.Halves) {
		for first := h * half; first < (h+1)*half; first += size {
			ranges = append(ranges, Range{First: first, Count: uint32(min(size, (h+1)*half-first))})
		}
	}
	return ranges
}
