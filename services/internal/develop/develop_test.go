package develop

import (
	"math"
	"testing"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/tally"
)

// TestPSSMLTScales develops a hand-made film: pixel = cells (A b / N + B c / NL) in each half.
func TestPSSMLTScales(t *testing.T) {
	shape := film.Shape{Width: 2, Height: 1, Layers: 2}
	f := film.New(shape)
	put := func(a film.Address, size int, value float64) {
		values := make([]int64, size)
		values[0] = int64(value * film.FixedOne)
		index, err := shape.Index(a)
		if err != nil {
			t.Fatal(err)
		}
		f.Add(film.Tile{Index: index, Values: values})
	}
	for plane, v := range []float64{10, 3, 20, 5} { // A0, B0, A1, B1
		put(film.Address{Plane: plane}, film.FullTileValues, v)
	}
	put(film.Address{Low: true, Plane: 5*2 + 1}, film.LowTileValues, 7)
	totals := ChainTotals{Cells: 6, Unit: 4, Samples: [2]tally.Sums{{Count: 10, Sum: 20}, {Count: 10, Sum: 50}}}
	for g := range film.StatGroups {
		totals.Mutations[g], totals.LargeSteps[g] = 100, 30
	}
	scales := PSSMLT(totals)
	images := Develop(f, scales)
	half0 := 6 * (10*2.0/800 + 3*4.0/240)
	half1 := 6 * (20*5.0/800 + 5*4.0/240)
	near := func(name string, got, want float64) {
		if math.Abs(got-want) > 1e-12 {
			t.Errorf("%s is %v, want %v", name, got, want)
		}
	}
	near("half 0", images.Halves[0][0], half0)
	near("half 1", images.Halves[1][0], half1)
	near("mean", images.Mean(0), (half0+half1)/2)
	near("dark pixel", images.Mean(3), 0)
	near("variance", images.Variance(0), (half0-half1)*(half0-half1)/4)
	near("b", scales.B.Mean(), 3.5)
	near("group 5", LowGroups(f, scales)[5][0], 6*7*4.0/30)
}

// TestDirectLight adds D d / n of the third layer: to each half its own samples, to each group those
// of all groups.
func TestDirectLight(t *testing.T) {
	shape := film.Shape{Width: 1, Height: 1, Layers: 3}
	f := film.New(shape)
	put := func(a film.Address, size int, value float64) {
		values := make([]int64, size)
		values[0] = int64(value * film.FixedOne)
		index, err := shape.Index(a)
		if err != nil {
			t.Fatal(err)
		}
		f.Add(film.Tile{Index: index, Values: values})
	}
	put(film.Address{Plane: 2}, film.FullTileValues, 6)
	put(film.Address{Plane: 5}, film.FullTileValues, 9)
	for g := range film.StatGroups {
		put(film.Address{Low: true, Plane: 3*g + 2}, film.LowTileValues, 1)
	}
	scales := PSSMLT(ChainTotals{Cells: 1, Unit: 4, Direct: 10, DirectUnit: 50})
	images := Develop(f, scales)
	if images.Halves[0][0] != 6*50.0/5 || images.Halves[1][0] != 9*50.0/5 || images.Mean(0) != 75 {
		t.Errorf("halves %v, %v", images.Halves[0][0], images.Halves[1][0])
	}
	for g, values := range LowGroups(f, scales) {
		if values[0] != 16*50.0/10 {
			t.Errorf("group %d has %v", g, values[0])
		}
	}
}

func TestPathScales(t *testing.T) {
	for n, want := range map[uint64][2]float64{1: {1, 0}, 2: {0.5, 0.5}, 3: {2.0 / 3, 1.0 / 3}, 20: {0.5, 0.5}} {
		s := Path(2, n)
		if s.Weights != want {
			t.Errorf("%d samples: weights %v", n, s.Weights)
		}
		sum := uint64(0)
		for g := range film.StatGroups {
			if s.Group[g][0] > 0 {
				sum += uint64(math.Round(2 / s.Group[g][0]))
			}
		}
		if sum != n {
			t.Errorf("%d samples: groups hold %d", n, sum)
		}
	}
}

func TestVarianceImageKeepsTheMeanOfAFlatField(t *testing.T) {
	m := Images{Shape: film.Shape{Width: 7, Height: 3, Layers: 1}, Weights: [2]float64{0.5, 0.5}}
	m.Halves = [2][]float64{make([]float64, 63), make([]float64, 63)}
	for i := range m.Halves[0] {
		m.Halves[0][i], m.Halves[1][i] = 3, 1
	}
	for i, v := range m.VarianceImage() {
		if v != 1 {
			t.Fatalf("value %d is %v", i, v)
		}
	}
}
