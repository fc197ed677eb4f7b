package plan

import (
	"slices"

	"google.golang.org/protobuf/proto"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

const (
	// MapSide is the number of columns, and of rows, of a map of where light lands.
	MapSide = 64
	// maxMapSide bounds maps that come from outside.
	maxMapSide = 64
	// mapFloor of a cell, relative to the mean of the image: below it a relative error counts less.
	mapFloor = 0.02
	// mapSmoothings with the binomial kernel 1 2 1 in both directions.
	mapSmoothings = 2
	// mapSeed is mixed into the job's seed: the map must not know the samples that it is used for.
	mapSeed = 0x6d6170
)

// NeedsMap tells whether a pilot has to find out where light lands: the target is to be equalized
// and no map is given.
func NeedsMap(spec *jobv1.ResolvedSpec, r job.Request) bool {
	return RunsChains(spec) && r.Target == job.TargetEqualized && r.Resolved == "" && spec.GetTargetMap() == nil
}

// MapPilot is the spec under which bootstrap tasks make the map: the same paths, all of them, with a
// seed of its own.
func MapPilot(spec *jobv1.ResolvedSpec) *jobv1.ResolvedSpec {
	pilot := proto.CloneOf(spec)
	pilot.DirectSizes, pilot.Layers = nil, nil
	pilot.Seed ^= mapSeed
	return pilot
}

// SetTarget fixes the target map from sums of luminance, MapSide x MapSide cells row by row: they
// are smoothed, raised to a floor and divided by the largest. Without light there is no map.
func SetTarget(spec *jobv1.ResolvedSpec, sums []float64) {
	smooth := slices.Clone(sums)
	for range mapSmoothings {
		smooth = binomial(binomial(smooth, 1, MapSide), MapSide, 1)
	}
	total := 0.0
	for _, v := range smooth {
		total += v
	}
	if !(total > 0) {
		return
	}
	floor := mapFloor * total / float64(len(smooth))
	largest := slices.Max(smooth)
	values := make([]float32, len(smooth))
	for i, v := range smooth {
		values[i] = float32(max(v, floor) / largest)
	}
	spec.TargetMap = &jobv1.TargetMap{Side: MapSide, Values: values}
}

// binomial smooths along one axis whose neighbours are step apart, lines being across apart; the
// borders repeat.
func binomial(in []float64, step, across int) []float64 {
	out := make([]float64, len(in))
	for line := range MapSide {
		for i := range MapSide {
			at := func(k int) float64 { return in[line*across+min(max(k, 0), MapSide-1)*step] }
			out[line*across+i*step] = (at(i-1) + 2*at(i) + at(i+1)) / 4
		}
	}
	return out
}

// checkMap says what is wrong with a target map, "" if nothing is.
func checkMap(m *jobv1.TargetMap) string {
	side := m.GetSide()
	switch {
	case m == nil:
		return ""
	case side < 1 || side > maxMapSide:
		return "target_map.side is outside 1..64"
	case len(m.GetValues()) != int(side*side):
		return "target_map does not have side * side values"
	}
	for _, v := range m.GetValues() {
		if !(v > 0 && v <= 1) {
			return "target_map has a value outside 0 < v <= 1"
		}
	}
	return ""
}

// densitySide of the points, in a cell of the film's low-resolution grid, that the map is read at.
const densitySide = 4

// TargetDensity is how much more a cell of the film's low-resolution planes is sought, per
// luminance, than without a target map: the mean of 1 over the map's values there. nil: everywhere
// alike.
func TargetDensity(spec *jobv1.ResolvedSpec) []float64 {
	m := spec.GetTargetMap()
	if m == nil {
		return nil
	}
	shape, side := Shape(spec), int(m.GetSide())
	at := func(cell, cellSize, point, pixels int) int {
		position := (float64(cell) + (float64(point)+0.5)/densitySide) * float64(cellSize) / float64(pixels)
		return min(int(position*float64(side)), side-1)
	}
	density := make([]float64, film.LowSize*film.LowSize)
	for cell := range density {
		for point := range densitySide * densitySide {
			column := at(cell%film.LowSize, shape.CellWidth(), point%densitySide, shape.Width)
			row := at(cell/film.LowSize, shape.CellHeight(), point/densitySide, shape.Height)
			density[cell] += 1 / float64(m.GetValues()[row*side+column]) / (densitySide * densitySide)
		}
	}
	return density
}
