// Package bootstrap turns the independent samples of a job into b with its standard error and into
// the seeds of the chains. It is pure.
package bootstrap

import (
	"fmt"
	"maps"
	"math"
	"slices"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/tally"
)

// Samples collects f of every bootstrap index. Half 0 owns the first half of the indices.
type Samples struct {
	values []float32
	maps   map[uint64][]float64 // by first index of the range
}

// NewSamples returns a collection of count zeros.
func NewSamples(count uint64) *Samples {
	return &Samples{values: make([]float32, count), maps: map[uint64][]float64{}}
}

// Set stores the values of a range. It refuses values that no luminance can have.
func (s *Samples) Set(first uint64, values []float32) error {
	if first > uint64(len(s.values)) || uint64(len(values)) > uint64(len(s.values))-first {
		return fmt.Errorf("bootstrap: indices %d + %d are out of range", first, len(values))
	}
	for i, v := range values {
		if !(v >= 0) || math.IsInf(float64(v), 0) {
			return fmt.Errorf("bootstrap: value %v at index %d is not finite and non-negative", v, first+uint64(i))
		}
	}
	copy(s.values[first:], values)
	return nil
}

// SetMap stores where the light of a range landed. It refuses maps of another size and values that
// no luminance can have.
func (s *Samples) SetMap(first uint64, sums []float64, cells int) error {
	if len(sums) != cells {
		return fmt.Errorf("bootstrap: a map of %d cells, not %d", len(sums), cells)
	}
	for _, v := range sums {
		if !(v >= 0) || math.IsInf(v, 0) {
			return fmt.Errorf("bootstrap: value %v of the map is not finite and non-negative", v)
		}
	}
	s.maps[first] = sums
	return nil
}

// Map adds up the maps of all ranges, in index order; nil without any.
func (s *Samples) Map() []float64 {
	var sum []float64
	for _, first := range slices.Sorted(maps.Keys(s.maps)) {
		if sum == nil {
			sum = make([]float64, len(s.maps[first]))
		}
		for i, v := range s.maps[first] {
			sum[i] += v
		}
	}
	return sum
}

// Values lists f by index.
func (s *Samples) Values() []float32 { return s.values }

// packSize samples in a row have one path length.
const packSize = 8

// Lengths returns the sums of F of each path length, one edge first, of a bootstrap of so many
// lengths (see ResolvedSpec.bootstrap_samples): every value reported is F times their number. The
// means add up to b.
func (s *Samples) Lengths(lengths int) []tally.Sums {
	sums := make([]tally.Sums, lengths)
	for i, v := range s.values {
		sums[i/packSize%lengths].Add(float64(v) / float64(lengths))
	}
	return sums
}

// Half returns the sums of one half, added in index order.
func (s *Samples) Half(half int) tally.Sums {
	var sums tally.Sums
	for _, v := range s.half(half) {
		sums.Add(float64(v))
	}
	return sums
}

func (s *Samples) half(half int) []float32 {
	middle := len(s.values) / film.Halves
	return s.values[half*middle : (half+1)*middle]
}

// Seed is where a chain starts.
type Seed struct {
	Index uint64
	Value float32
}

// Seeds draws the seeds of all chains: Seeds[g] for group g, in chain order. Each half resamples
// its own indices systematically in proportion to f: with total F and K chains, the points
// (j + u) F / K for j < K. The draws go round the half's groups, so each group is itself a
// systematic sample. A half without light has no seeds: its groups are nil.
func (s *Samples) Seeds(seed uint64, groups, groupSize int) [][]Seed {
	seeds := make([][]Seed, groups)
	for half := range film.Halves {
		drawn := s.systematic(half, seed, groups/film.Halves*groupSize)
		for j, d := range drawn {
			g := half + film.Halves*(j%(groups/film.Halves))
			seeds[g] = append(seeds[g], d)
		}
	}
	return seeds
}

func (s *Samples) systematic(half int, seed uint64, count int) []Seed {
	values := s.half(half)
	total := 0.0
	for _, v := range values {
		total += float64(v)
	}
	if !(total > 0) {
		return nil
	}
	first := uint64(half * len(values))
	offset := uniform(seed, half)
	drawn := make([]Seed, 0, count)
	sum, last := 0.0, 0
	for i, v := range values {
		if v == 0 {
			continue
		}
		sum, last = sum+float64(v), i
		for len(drawn) < count && (float64(len(drawn))+offset)*total < sum*float64(count) {
			drawn = append(drawn, Seed{Index: first + uint64(i), Value: v})
		}
	}
	// Rounding may leave the last point just beyond the sum.
	for len(drawn) < count {
		drawn = append(drawn, Seed{Index: first + uint64(last), Value: values[last]})
	}
	return drawn
}

// uniform in [0, 1), a function of (job seed, half): the finalizer of SplitMix64 over a key of its
// own, so no other stream of the job shares it.
func uniform(seed uint64, half int) float64 {
	const stream = 0x6d6574726f736565
	z := seed ^ stream ^ uint64(half)<<32
	for range 2 {
		z += 0x9e3779b97f4a7c15
		z = (z ^ z>>30) * 0xbf58476d1ce4e5b9
		z = (z ^ z>>27) * 0x94d049bb133111eb
		z ^= z >> 31
	}
	return float64(z>>11) / (1 << 53)
}
