// Package convergence estimates how far an image is from the truth. It is pure.
//
// The estimate is the relative mean squared error of the mean of two independent halves. Its
// interval comes from eight pairs of statistics groups at low resolution: the spread of their own
// relative errors is taken, in logarithms, as that of the full estimate. Limits: averaging over
// cells hides noise that is local to pixels and keeps what is common to many, so the interval is an
// indication; groups of one half share bootstrap seeds and b, so it does not widen for what all
// groups missed. On the rare target of the tests the 95 % interval holds the true error in only a
// third of renders, because the estimate itself is a third too large there.
package convergence

import (
	"math"

	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

// Level of the confidence interval.
const Level = 0.95

// darkness is the share of the squared mean that keeps dark pixels from dominating.
const darkness = 0.01

// student holds the 0.975 quantiles of Student's t by degrees of freedom, from 1.
var student = [...]float64{12.706205, 4.302653, 3.182446, 2.776445, 2.570582, 2.446912, 2.364624}

// Estimate is a relative mean squared error with its interval.
type Estimate struct {
	RelMSE   float64
	Interval job.Interval
	// Known is false where a half has no samples; the rest is then zero.
	Known bool
}

// Of estimates the error of a film developed with these scales.
func Of(images develop.Images, groups [film.StatGroups][]float64, scales develop.Scales) Estimate {
	if images.Weights[0] == 0 || images.Weights[1] == 0 {
		return Estimate{}
	}
	relMSE := halves(images)
	spread := logHalfWidth(groups, scales, images.Shape)
	interval := job.Interval{Low: relMSE, High: relMSE}
	if spread > 0 {
		interval = job.Interval{Low: relMSE * math.Exp(-spread), High: relMSE * math.Exp(spread), Level: Level}
	}
	return Estimate{RelMSE: relMSE, Interval: interval, Known: true}
}

// agreement is the relative squared half difference up to which a pixel is its own reference.
const agreement = 0.1

// halves compares the halves pixel by pixel, relative to a stand-in for the unknown truth. The mean
// of the halves would not do: a bright outlier would hide itself by raising what it is divided by.
// Where the halves agree the stand-in is their product, which is unbiased for the truth's square;
// where they do not, the squared mean of the neighbours, which knows nothing of the pixel's own
// error. A sharp feature that one half has missed makes the estimate too large until both have seen
// it: it errs on the side of rendering on.
func halves(images develop.Images) float64 {
	around := images.NeighbourMean()
	mean := 0.0
	for _, m := range around {
		mean += m
	}
	mean /= float64(len(around))
	sum := 0.0
	for i, m := range around {
		square := images.Halves[0][i] * images.Halves[1][i]
		if images.Variance(i) > agreement*square {
			square = m * m
		}
		sum += relative(images.Variance(i), square, mean)
	}
	return sum / float64(len(around))
}

// relative is 0 for a black value of a black image.
func relative(squaredError, square, mean float64) float64 {
	if squaredError == 0 {
		return 0
	}
	return squaredError / (square + darkness*mean*mean)
}

// logHalfWidth is the half width of the interval in logarithms, 0 if it cannot be told.
func logHalfWidth(groups [film.StatGroups][]float64, scales develop.Scales, shape film.Shape) float64 {
	used := usedPairs(scales)
	if len(used) < 2 {
		return 0
	}
	errors := pairErrors(groups, used, shape)
	mean, sd := meanAndDeviation(errors)
	if !(mean > 0) {
		return 0
	}
	n := float64(len(errors))
	// Beyond e^5 either way the interval says nothing more.
	return min(5, student[len(errors)-2]*sd/(mean*math.Sqrt(n)))
}

// usedPairs lists the even members of pairs (g, g + 1) that both have samples.
func usedPairs(scales develop.Scales) []int {
	var used []int
	for g := 0; g < film.StatGroups; g += 2 {
		if hasSamples(scales.Group[g]) && hasSamples(scales.Group[g+1]) {
			used = append(used, g)
		}
	}
	return used
}

func hasSamples(scale []float64) bool {
	for _, s := range scale {
		if s != 0 {
			return true
		}
	}
	return false
}

// pairErrors is the relative error of each pair, against the mean of all pairs.
func pairErrors(groups [film.StatGroups][]float64, used []int, shape film.Shape) []float64 {
	overall := make([]float64, film.LowTileValues)
	for _, g := range used {
		for i := range overall {
			overall[i] += (groups[g][i] + groups[g+1][i]) / float64(2*len(used))
		}
	}
	var cells []int
	mean := 0.0
	for cell := range film.LowSize * film.LowSize {
		if shape.CellPixels(cell%film.LowSize, cell/film.LowSize) == 0 {
			continue
		}
		for c := range film.Channels {
			cells = append(cells, cell*film.Channels+c)
			mean += overall[cell*film.Channels+c]
		}
	}
	mean /= float64(len(cells))
	errors := make([]float64, len(used))
	for k, g := range used {
		for _, i := range cells {
			d := (groups[g][i] - groups[g+1][i]) / 2
			errors[k] += relative(d*d, overall[i]*overall[i], mean) / float64(len(cells))
		}
	}
	return errors
}

func meanAndDeviation(values []float64) (mean, sd float64) {
	n := float64(len(values))
	for _, v := range values {
		mean += v / n
	}
	for _, v := range values {
		sd += (v - mean) * (v - mean) / (n - 1)
	}
	return mean, math.Sqrt(sd)
}
