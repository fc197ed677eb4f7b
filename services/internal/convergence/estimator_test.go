package convergence_test

import (
	"math"
	"math/rand/v2"
	"testing"

	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/convergence"
	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/tally"
)

// The rare target: a function on [0, 1)^3 whose first two coordinates are the position on an image
// of 16 x 16 pixels. Nine tenths of its light sit on a ridge that covers 4.8e-4 of the third
// coordinate, so its relative variance is above 1000, while the image itself is smooth.
const (
	side        = 16
	pixels      = side * side
	ridgeWidth  = 4.8e-4
	baseHeight  = 0.1
	ridgeHeight = 0.9 / ridgeWidth
)

type point [3]float64

var rareShape = film.Shape{Width: side, Height: side, Layers: 2}

// brightness of the ridge over the image; its mean is 1.
func brightness(x, y float64) float64 {
	return 1 + 0.8*math.Sin(2*math.Pi*x)*math.Cos(2*math.Pi*y)
}

// rare is f; its integral is 1. The ridge runs askew, so that a mutation of the position leaves it.
func rare(u point) float64 {
	at := u[2] - 0.02*u[0] - 0.01*u[1] - 0.1
	if at -= math.Floor(at); at < ridgeWidth {
		return baseHeight + ridgeHeight*brightness(u[0], u[1])
	}
	return baseHeight
}

func pixelOf(u point) int {
	return min(side-1, int(u[1]*side))*side + min(side-1, int(u[0]*side))
}

// rareImage is the exact image: the mean of f over each pixel, in units in which the mean is 1.
func rareImage() []float64 {
	image := make([]float64, pixels)
	const fine = 32
	for i := range image {
		for k := range fine * fine {
			x := (float64(i%side) + (float64(k%fine)+0.5)/fine) / side
			y := (float64(i/side) + (float64(k/fine)+0.5)/fine) / side
			image[i] += (baseHeight + 0.9*brightness(x, y)) / (fine * fine)
		}
	}
	return image
}

// experiment is one complete PSSMLT render of the rare target.
type experiment struct {
	random   *rand.Rand
	film     *film.Film
	full     [4][]int64
	low      [32][]int64
	totals   develop.ChainTotals
	largeP   float64
	mutation int // per chain
}

const (
	halfSamples    = 20000
	groups         = 16
	chainsPerGroup = 8
)

func render(seed uint64) (develop.Images, convergence.Estimate) {
	e := &experiment{random: rand.New(rand.NewPCG(seed, 99)), film: film.New(rareShape), largeP: 0.3, mutation: 1500}
	for p := range e.full {
		e.full[p] = make([]int64, film.FullTileValues)
	}
	for p := range e.low {
		e.low[p] = make([]int64, film.LowTileValues)
	}
	e.totals.Cells = pixels
	e.runChains(e.bootstrap(seed))
	for p, values := range e.full {
		e.add(film.Address{Plane: p}, values)
	}
	for p, values := range e.low {
		e.add(film.Address{Low: true, Plane: p}, values)
	}
	scales := develop.PSSMLT(e.totals)
	images := develop.Develop(e.film, scales)
	return images, convergence.Of(images, develop.LowGroups(e.film, scales), scales)
}

func (e *experiment) add(a film.Address, values []int64) {
	index, err := rareShape.Index(a)
	if err != nil {
		panic(err)
	}
	e.film.Add(film.Tile{Index: index, Values: values})
}

// bootstrap draws the samples, sets b and the unit, and returns where each chain starts.
func (e *experiment) bootstrap(seed uint64) [][]point {
	samples := bootstrap.NewSamples(2 * halfSamples)
	points, values := make([]point, 2*halfSamples), make([]float32, 2*halfSamples)
	for i := range points {
		points[i] = e.anywhere()
		values[i] = float32(rare(points[i]))
	}
	if err := samples.Set(0, values); err != nil {
		panic(err)
	}
	e.totals.Samples = [2]tally.Sums{samples.Half(0), samples.Half(1)}
	e.totals.Unit = (e.totals.Samples[0].Mean() + e.totals.Samples[1].Mean()) / 2
	starts := make([][]point, groups)
	for g, seeds := range samples.Seeds(seed, groups, chainsPerGroup) {
		for _, s := range seeds {
			starts[g] = append(starts[g], points[s.Index])
		}
	}
	return starts
}

func (e *experiment) runChains(starts [][]point) {
	for g, chains := range starts {
		for _, u := range chains {
			e.runChain(g, u)
		}
	}
}

func (e *experiment) runChain(g int, u point) {
	unit := e.totals.Unit
	m := func(f float64) float64 { return f / unit / (f/unit + e.largeP) }
	var large tally.Sums
	fu := rare(u)
	for range e.mutation {
		v, isLarge := e.propose(u)
		fv := rare(v)
		a := min(1, fv/fu)
		e.splat(g, 0, v, a*m(fv))
		e.splat(g, 0, u, (1-a)*m(fu))
		if isLarge {
			e.splat(g, 1, v, (1-m(fv))*fv/unit)
			large.Add(fv / unit)
		}
		if e.random.Float64() < a {
			u, fu = v, fv
		}
	}
	e.totals.Mutations[g] += uint64(e.mutation)
	e.totals.LargeSteps[g] += large.Count
	e.totals.Samples[g%2].Merge(large, unit)
}

func (e *experiment) anywhere() point {
	return point{e.random.Float64(), e.random.Float64(), e.random.Float64()}
}

func (e *experiment) propose(u point) (v point, isLarge bool) {
	if e.random.Float64() < e.largeP {
		return e.anywhere(), true
	}
	for k := range u {
		step := 1e-2 * math.Exp(-math.Log(1e3)*e.random.Float64())
		if e.random.Float64() < 0.5 {
			step = -step
		}
		v[k] = u[k] + step - math.Floor(u[k]+step)
	}
	return v, false
}

func (e *experiment) splat(g, layer int, u point, value float64) {
	i := pixelOf(u)
	x, y := i%side, i/side
	fixed := int64(math.Round(value * film.FixedOne))
	for c := range film.Channels {
		e.full[g%2*2+layer][(c*film.TileSize+y)*film.TileSize+x] += fixed
		e.low[g*2+layer][c*film.LowSize*film.LowSize+i] += fixed
	}
}

func trueRelMSE(images develop.Images, reference []float64) float64 {
	sum := 0.0
	for i := range images.Halves[0] {
		ref := reference[i/film.Channels]
		d := images.Mean(i) - ref
		sum += d * d / (ref*ref + 0.01)
	}
	return sum / float64(len(images.Halves[0]))
}

// TestEstimateOnRareFeatures. Null hypothesis: the mean estimate over the mean true relMSE lies in
// 0.5..2. Sample: 40 complete renders, bootstrap and seeds included. Over 20 repetitions
// (TestMeasureRatio) the logarithm of the ratio had mean 0.29 and standard deviation 0.06, so a ratio
// above 2 is 6.9 deviations away: a false alarm is below 1e-10. With a quarter of the mutations, when
// most pixels have not seen the ridge, the ratio is 2.0: the estimate starts too large. Halves that
// share their bootstrap miss by orders of magnitude.
func TestEstimateOnRareFeatures(t *testing.T) {
	if relative := 0.9 * 0.9 / ridgeWidth; relative < 1000 {
		t.Fatalf("relative variance %v is not rare", relative)
	}
	ratio, inside := measure(1, 40)
	t.Logf("ratio %.3f, true error inside the interval in %.0f %%", ratio, 100*inside)
	if ratio < 0.5 || ratio > 2 {
		t.Errorf("mean estimate / mean true relMSE = %v, not within 0.5..2", ratio)
	}
}

func measure(first uint64, runs int) (ratio, inside float64) {
	reference := rareImage()
	estimate, truth := 0.0, 0.0
	for run := range uint64(runs) {
		images, e := render(first*1000 + run)
		actual := trueRelMSE(images, reference)
		estimate, truth = estimate+e.RelMSE, truth+actual
		if actual >= e.Interval.Low && actual <= e.Interval.High {
			inside += 1 / float64(runs)
		}
	}
	return estimate / truth, inside
}
