// Package develop scales the exact sums of a film into images. It is pure.
//
// With cells the number of film cells, N the mutations and NL the large steps of a part (a half or
// a statistics group), b the half's own estimate and c the film unit, a PSSMLT pixel is
//
//	cells (A b / N + B c / NL)
//
// where A and B are the sums of layers 0 and 1: the worker's raster positions are uniform over the
// cells and the filter integrates to one per pixel. Direct light apart adds D d / n of layer 2, d
// being its unit and n its samples per cell. A path-traced pixel is P c / n with n samples
// per cell.
package develop

import (
	"slices"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/tally"
)

// Scales turn the planes of a film into radiance.
type Scales struct {
	Half    [film.Halves][]float64     // by layer
	Group   [film.StatGroups][]float64 // by layer, of the low-resolution planes
	Weights [film.Halves]float64       // of the halves in the mean
	B       tally.Sums                 // pooled over both halves; empty for path tracing
	// Common scales low-resolution planes that all groups share: their sum goes to each group.
	Common []float64 // by layer
}

// ChainTotals is what the scales of a PSSMLT film depend on.
type ChainTotals struct {
	Cells      int
	Unit       float64
	Mutations  [film.StatGroups]uint64
	LargeSteps [film.StatGroups]uint64
	// Direct samples per cell and the unit of their layer, the third; 0 where it does not exist.
	Direct     uint64
	DirectUnit float64
	// Samples are all independent samples of f of a half, in absolute units: the bootstrap's and
	// the large steps'.
	Samples [film.Halves]tally.Sums
}

// PSSMLT returns the scales of a film of two layers. A half without light has b = 0 and stays
// black in its half of the mean.
func PSSMLT(t ChainTotals) Scales {
	s := Scales{Weights: [film.Halves]float64{0.5, 0.5}}
	var mutations, largeSteps [film.Halves]uint64
	cells := float64(t.Cells)
	scale := func(half int, n, large uint64) []float64 {
		return []float64{
			ratio(cells*t.Samples[half].Mean(), n),
			ratio(cells*t.Unit, large),
		}
	}
	for g := range film.StatGroups {
		mutations[g%film.Halves] += t.Mutations[g]
		largeSteps[g%film.Halves] += t.LargeSteps[g]
		s.Group[g] = scale(g%film.Halves, t.Mutations[g], t.LargeSteps[g])
	}
	for h := range film.Halves {
		s.Half[h] = scale(h, mutations[h], largeSteps[h])
		s.B.Merge(t.Samples[h], 1)
	}
	if t.Direct > 0 {
		s.addDirect(t)
	}
	return s
}

// addDirect scales the layer of direct light. Its samples are stratified over the cells, so groups
// of them say little about its error, which is small beside that of the chains: each group gets all
// of it.
func (s *Scales) addDirect(t ChainTotals) {
	for h := range film.Halves {
		s.Half[h] = append(s.Half[h], ratio(t.DirectUnit, residues(t.Direct, film.Halves, h)))
	}
	s.Common = []float64{0, 0, ratio(t.DirectUnit, t.Direct)}
}

// Path returns the scales of a film of one layer after n samples per cell: sample i went to half
// i % 2 and to statistics group i % 16.
func Path(unit float64, n uint64) Scales {
	var s Scales
	for h := range film.Halves {
		samples := residues(n, film.Halves, h)
		s.Half[h] = []float64{ratio(unit, samples)}
		s.Weights[h] = ratio(float64(samples), n)
	}
	for g := range film.StatGroups {
		s.Group[g] = []float64{ratio(unit, residues(n, film.StatGroups, g))}
	}
	return s
}

// residues counts i < n with i % modulus == r.
func residues(n uint64, modulus, r int) uint64 {
	return (n + uint64(modulus-1-r)) / uint64(modulus)
}

// ratio is 0 where nothing was counted.
func ratio(v float64, n uint64) float64 {
	if n == 0 {
		return 0
	}
	return v / float64(n)
}

// Images are the developed halves: 3 values per pixel, row by row.
type Images struct {
	Shape   film.Shape
	Halves  [film.Halves][]float64
	Weights [film.Halves]float64
}

// Develop scales the full-resolution planes.
func Develop(f *film.Film, s Scales) Images {
	shape := f.Shape()
	images := Images{Shape: shape, Weights: s.Weights}
	for h := range film.Halves {
		images.Halves[h] = make([]float64, shape.Width*shape.Height*film.Channels)
		for l, scale := range s.Half[h] {
			f.AddPlane(images.Halves[h], h*shape.Layers+l, scale)
		}
	}
	return images
}

// Mean is value i of the image: the halves weighted by their share of the work.
func (m *Images) Mean(i int) float64 {
	return m.Weights[0]*m.Halves[0][i] + m.Weights[1]*m.Halves[1][i]
}

// Variance is the estimate of the variance of Mean(i). For independent halves whose variance goes
// with the inverse of their weights w0 + w1 = 1, E[w0 w1 (I0 - I1)^2] is that variance; it has one
// degree of freedom.
func (m *Images) Variance(i int) float64 {
	d := m.Halves[0][i] - m.Halves[1][i]
	return m.Weights[0] * m.Weights[1] * d * d
}

// LowGroups develops the low-resolution planes: per statistics group 16 x 16 cells of 3 values, the
// mean radiance of each cell's pixels. Cells outside the image are zero.
func LowGroups(f *film.Film, s Scales) [film.StatGroups][]float64 {
	shape := f.Shape()
	var groups [film.StatGroups][]float64
	common := make([]float64, film.LowTileValues)
	for l, scale := range s.Common {
		for g := range film.StatGroups {
			f.AddLowPlane(common, g*shape.Layers+l, scale)
		}
	}
	for g := range film.StatGroups {
		values := slices.Clone(common)
		for l, scale := range s.Group[g] {
			f.AddLowPlane(values, g*shape.Layers+l, scale)
		}
		for cell := range film.LowSize * film.LowSize {
			pixels := shape.CellPixels(cell%film.LowSize, cell/film.LowSize)
			for c := range film.Channels {
				values[cell*film.Channels+c] = ratio(values[cell*film.Channels+c], uint64(pixels))
			}
		}
		groups[g] = values
	}
	return groups
}
