package bootstrap

import (
	"math"
	"math/rand/v2"
	"reflect"
	"testing"
)

func filled(t *testing.T, n int, f func(i int) float32) *Samples {
	t.Helper()
	s := NewSamples(uint64(n))
	values := make([]float32, n)
	for i := range values {
		values[i] = f(i)
	}
	if err := s.Set(0, values); err != nil {
		t.Fatal(err)
	}
	return s
}

// TestSystematicCounts: systematic resampling draws index i either floor or ceil of K f_i / F times.
func TestSystematicCounts(t *testing.T) {
	random := rand.New(rand.NewPCG(1, 1))
	s := filled(t, 2000, func(int) float32 { return float32(math.Pow(random.Float64(), 10)) })
	const groups, groupSize = 32, 64
	for seed := range uint64(20) {
		counts := make([]int, 2000)
		for g, seeds := range s.Seeds(seed, groups, groupSize) {
			if len(seeds) != groupSize {
				t.Fatalf("group %d has %d seeds", g, len(seeds))
			}
			for _, d := range seeds {
				if half := int(d.Index) / 1000; half != g%2 || s.values[d.Index] != d.Value {
					t.Fatalf("group %d starts from index %d with %v", g, d.Index, d.Value)
				}
				counts[d.Index]++
			}
		}
		for i, n := range counts {
			expected := groups / 2 * groupSize * float64(s.values[i]) / s.Half(i/1000).Sum
			if math.Abs(float64(n)-expected) > 1+1e-9 {
				t.Fatalf("seed %d: index %d drawn %d times, expected %v", seed, i, n, expected)
			}
		}
	}
}

func TestSeedsAreAFunctionOfTheSeed(t *testing.T) {
	s := filled(t, 256, func(i int) float32 { return float32(i % 7) })
	if !reflect.DeepEqual(s.Seeds(1, 16, 8), s.Seeds(1, 16, 8)) {
		t.Error("equal seeds, different draws")
	}
	if reflect.DeepEqual(s.Seeds(1, 16, 8), s.Seeds(2, 16, 8)) {
		t.Error("different seeds, equal draws")
	}
}

func TestDarkHalfHasNoSeeds(t *testing.T) {
	s := filled(t, 256, func(i int) float32 { return float32(i / 128) })
	for g, seeds := range s.Seeds(1, 16, 4) {
		if want := 4 * (g % 2); len(seeds) != want {
			t.Errorf("group %d has %d seeds, not %d", g, len(seeds), want)
		}
	}
	if s.Half(0).Mean() != 0 || s.Half(1).Mean() != 1 {
		t.Errorf("halves %v and %v", s.Half(0), s.Half(1))
	}
}

func TestOneBrightIndexSeedsAll(t *testing.T) {
	s := filled(t, 256, func(i int) float32 { return map[int]float32{127: 1e-30, 255: 3e38}[i] })
	for g, seeds := range s.Seeds(1, 16, 4) {
		for _, d := range seeds {
			if want := uint64(127 + 128*(g%2)); d.Index != want {
				t.Errorf("group %d starts from %d, not %d", g, d.Index, want)
			}
		}
	}
}

func TestSetRefuses(t *testing.T) {
	s := NewSamples(10)
	for name, err := range map[string]error{
		"nan":      s.Set(0, []float32{float32(math.NaN())}),
		"infinite": s.Set(0, []float32{float32(math.Inf(1))}),
		"negative": s.Set(0, []float32{-1}),
		"beyond":   s.Set(9, []float32{1, 1}),
		"overflow": s.Set(math.MaxUint64, []float32{1}),
	} {
		if err == nil {
			t.Errorf("%s: accepted", name)
		}
	}
}

func TestStandardErrorOfABernoulli(t *testing.T) {
	s := filled(t, 20000, func(i int) float32 { return float32(i % 2) })
	want := math.Sqrt(0.25 / 10000)
	if half := s.Half(0); half.Mean() != 0.5 || math.Abs(half.StandardError()/want-1) > 1e-3 {
		t.Errorf("mean %v, error %v, want %v", half.Mean(), half.StandardError(), want)
	}
}

// TestLengths: of value F n at each sample, the means of F are told apart by length and add up to
// the mean of all values.
func TestLengths(t *testing.T) {
	const lengths = 5
	s := filled(t, 128*lengths, func(i int) float32 { return lengths * float32(i/8%lengths) })
	total := 0.0
	for k, sums := range s.Lengths(lengths) {
		if sums.Count != 128 || sums.Mean() != float64(k) {
			t.Errorf("length %d: %+v", k+1, sums)
		}
		total += sums.Mean()
	}
	if all := (s.Half(0).Mean() + s.Half(1).Mean()) / 2; total != all {
		t.Errorf("the lengths have %v, the samples %v", total, all)
	}
}
