package diagnose

import (
	"math"
	"math/rand/v2"
	"sort"
	"testing"

	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/tally"
)

const perGroup = 20000

// draws fills a film with synthetic chains: each value drawn from the target stays for `repeats`
// mutations. The target's value at a point is target(cell), its luminance that over density(cell).
// Both layers get what a two-layer worker would splat for a film unit equal to b.
func draws(repeats int, target, density func(cell int) float64) (*film.Film, develop.ChainTotals) {
	const p = 0.3
	random := rand.New(rand.NewPCG(7, uint64(repeats)))
	shape := film.Shape{Width: 64, Height: 64, Layers: 2}
	f := film.New(shape)
	cumulative := make([]float64, cells)
	b := 0.0
	for cell := range cells {
		b += target(cell) / cells
		cumulative[cell] = b
	}
	draw := func() int {
		u := random.Float64() * b
		return sort.SearchFloat64s(cumulative, u)
	}
	t := develop.ChainTotals{Cells: 64 * 64, Unit: b, Samples: [2]tally.Sums{{Count: 2, Sum: 2 * b}, {Count: 2, Sum: 2 * b}}}
	for g := range film.StatGroups {
		chain, large := make([]int64, film.LowTileValues), make([]int64, film.LowTileValues)
		splat := func(into []int64, cell int, v float64) {
			for c := range film.Channels {
				into[c*cells+cell] += int64(v / density(cell) * film.FixedOne)
			}
		}
		for range perGroup / repeats {
			cell := draw()
			m := target(cell) / (target(cell) + p*b)
			splat(chain, cell, float64(repeats)*m)
		}
		for range perGroup {
			cell := random.IntN(cells)
			splat(large, cell, p*target(cell)/(target(cell)+p*b))
		}
		add(f, 2*g, chain)
		add(f, 2*g+1, large)
		t.Mutations[g], t.LargeSteps[g] = perGroup, perGroup
	}
	return f, t
}

func add(f *film.Film, plane int, values []int64) {
	index, err := f.Shape().Index(film.Address{Low: true, Plane: plane})
	if err != nil {
		panic(err)
	}
	f.Add(film.Tile{Index: index, Values: values})
}

func even(int) float64 { return 1 }

// uneven has values from 0.2 to 5.
func uneven(cell int) float64 { return 0.2 * math.Pow(25, float64(cell%film.LowSize)/(film.LowSize-1)) }

// check compares with N / repeats. Each of about 200 cells has a variance of 15 degrees of freedom,
// whose relative standard deviation is 0.365; the median of them has 1.25 * 0.365 / sqrt(200) = 0.032.
// Five of these give a false alarm below 1e-6.
func check(t *testing.T, name string, got Effective, repeats int) {
	t.Helper()
	want := float64(film.StatGroups*perGroup) / float64(repeats)
	if math.Abs(got.Samples/want-1) > 0.16 {
		t.Errorf("%s, repeated %d times: %v effective samples, want %v", name, repeats, got.Samples, want)
	}
	if ratio := got.PerMutation * film.StatGroups * perGroup; math.Abs(ratio/got.Samples-1) > 1e-12 {
		t.Errorf("%s: %v per mutation, %v in all", name, got.PerMutation, got.Samples)
	}
}

func TestIndependentAndRepeatedDraws(t *testing.T) {
	for _, repeats := range []int{1, 4, 50} {
		f, totals := draws(repeats, even, even)
		check(t, "even target", EffectiveSamples(f, totals, nil), repeats)
		f, totals = draws(repeats, uneven, even)
		check(t, "uneven target", EffectiveSamples(f, totals, nil), repeats)
	}
}

// TestEqualizedTarget: the target is even where the image is not.
func TestEqualizedTarget(t *testing.T) {
	density := make([]float64, cells)
	for cell := range density {
		density[cell] = 2 + float64(cell%film.LowSize)/8
	}
	for _, repeats := range []int{1, 10} {
		f, totals := draws(repeats, even, func(cell int) float64 { return density[cell] })
		check(t, "equalized", EffectiveSamples(f, totals, density), repeats)
		if got := EffectiveSamples(f, totals, nil); got.PerMutation*float64(repeats) < 2 {
			t.Errorf("the density does not matter: %v", got)
		}
	}
}

func TestUnknown(t *testing.T) {
	f, totals := draws(1, even, even)
	if got := EffectiveSamples(film.New(f.Shape()), totals, nil); got != (Effective{}) {
		t.Errorf("a black film has %v", got)
	}
	dark := totals
	dark.Samples = [2]tally.Sums{}
	if got := EffectiveSamples(f, dark, nil); got != (Effective{}) {
		t.Errorf("without b there are %v", got)
	}
	if got := EffectiveSamples(f, develop.ChainTotals{Unit: 1}, nil); got != (Effective{}) {
		t.Errorf("without mutations there are %v", got)
	}
}
