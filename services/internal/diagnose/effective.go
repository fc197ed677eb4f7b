// Package diagnose tells how well chains explore: how many independent samples they are worth. It is
// pure.
package diagnose

import (
	"math"
	"slices"

	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/film"
)

const (
	cells = film.LowSize * film.LowSize
	// smallestShare of the target that a cell must hold to count: a quarter of an even share. With
	// fewer visits their variance is not that of a normal law.
	smallestShare = 0.25 / cells
)

// Effective sample size of all chains of a film.
type Effective struct {
	// Samples, 0 where they cannot be told.
	Samples float64
	// PerMutation is their ratio to the mutations; 1 for independent samples of the target.
	PerMutation float64
}

// EffectiveSamples estimates how many independent samples of the chains' target f / b would tell
// the light in a cell of the 16 x 16 grid as exactly as the chains do.
//
// A visit to cell i leaves luminance k_i in the chain layer, about the same whatever the path. With
// q_i the target's share of the cell, n independent samples leave k_i q_i each on average, with the
// variance k_i^2 q_i (1 - q_i) / n. The statistics groups have means x_gi of the chain layer per
// mutation, whose sample variance s_i^2 is that of a group's chains. Equating the two,
//
//	ESS_i = groups k_i^2 q_i (1 - q_i) / s_i^2,  k_i = x_i / q_i,  q_i = density_i (x_i + y_i c / b)
//
// with x_i and y_i the means of the chain layer per mutation and of the large-step layer per large
// step, c the film unit: what large steps take off the chains is put back. density is of
// plan.TargetDensity. The estimate is the median over the cells with at least a quarter of an even
// share, corrected for the median of a chi-square variable. Where a sample leaves several splats, or
// the target map varies within a cell, k varies and the figure is too large.
//
// Limits: the light of all groups of a half starts from the same bootstrap samples, and what no chain
// has found does not count.
func EffectiveSamples(f *film.Film, t develop.ChainTotals, density []float64) Effective {
	groups, mutations := used(t)
	if len(groups) < 2 {
		return Effective{}
	}
	b := meanF(t)
	if !(b > 0) {
		return Effective{}
	}
	layers := f.Shape().Layers
	var chain [film.StatGroups][]float64
	large := make([]float64, cells)
	for _, g := range groups {
		chain[g] = make([]float64, cells)
		addLuminance(chain[g], f, g*layers, 1/float64(t.Mutations[g]))
		if t.LargeSteps[g] > 0 {
			addLuminance(large, f, g*layers+1, 1/float64(t.LargeSteps[g])/float64(len(groups)))
		}
	}
	var perCell []float64
	for cell := range cells {
		x, variance := meanAndVariance(chain, groups, cell)
		q := x + large[cell]*t.Unit/b
		if density != nil {
			q *= density[cell]
		}
		if q >= smallestShare && q < 1 && variance > 0 {
			perCell = append(perCell, float64(len(groups))*x*x*(1-q)/(q*variance))
		}
	}
	if len(perCell) == 0 {
		return Effective{}
	}
	samples := median(perCell) * chiSquareMedian(len(groups)-1)
	return Effective{Samples: samples, PerMutation: samples / float64(mutations)}
}

// used lists the statistics groups that have mutations, and sums these.
func used(t develop.ChainTotals) (groups []int, mutations uint64) {
	for g, n := range t.Mutations {
		if n > 0 {
			groups = append(groups, g)
			mutations += n
		}
	}
	return groups, mutations
}

// meanF is b, of both halves.
func meanF(t develop.ChainTotals) float64 {
	all := t.Samples[0]
	all.Merge(t.Samples[1], 1)
	return all.Mean()
}

func addLuminance(dst []float64, f *film.Film, plane int, scale float64) {
	values := make([]float64, film.LowTileValues)
	f.AddLowPlane(values, plane, scale)
	for cell := range dst {
		dst[cell] += develop.MeanLuminance(values[cell*film.Channels : (cell+1)*film.Channels])
	}
}

func meanAndVariance(values [film.StatGroups][]float64, groups []int, cell int) (mean, variance float64) {
	n := float64(len(groups))
	for _, g := range groups {
		mean += values[g][cell] / n
	}
	for _, g := range groups {
		d := values[g][cell] - mean
		variance += d * d / (n - 1)
	}
	return mean, variance
}

func median(values []float64) float64 {
	slices.Sort(values)
	n := len(values)
	return (values[(n-1)/2] + values[n/2]) / 2
}

// chiSquareMedian of so many degrees of freedom, divided by them (Wilson and Hilferty 1931): a sample
// variance is below the variance more often than not.
func chiSquareMedian(degrees int) float64 {
	return math.Pow(1-2/(9*float64(degrees)), 3)
}
