package convergence_test

import (
	"math"
	"math/rand/v2"
	"os"
	"testing"

	"metrofarm/services/internal/convergence"
	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/film"
)

// TestKnownVariance. Halves of 64 x 64 pixels around 2 with standard deviation 0.3 in each of 3
// channels. Null hypothesis: the expected estimate is (0.3^2 / 2) / (4 + 0.04). Sample: 12288 values,
// whose chi-square mean has relative standard deviation sqrt(2 / 12288) = 0.0128; six deviations
// give a false alarm below 1e-8.
func TestKnownVariance(t *testing.T) {
	random := rand.New(rand.NewPCG(1, 1))
	const n, mean, sd = 64 * 64 * 3, 2.0, 0.3
	images := develop.Images{Shape: film.Shape{Width: 64, Height: 64, Layers: 1}, Weights: [2]float64{0.5, 0.5}}
	for h := range images.Halves {
		images.Halves[h] = make([]float64, n)
		for i := range images.Halves[h] {
			images.Halves[h][i] = mean + sd*random.NormFloat64()
		}
	}
	e := convergence.Of(images, [film.StatGroups][]float64{}, develop.Scales{})
	// The denominator holds the noisy mean, whose square is on average larger by sd^2 / 2.
	want := (sd * sd / 2) / (mean*mean + 0.01*mean*mean)
	if math.Abs(e.RelMSE/want-1) > 6*math.Sqrt(2.0/n)+0.03 || !e.Known {
		t.Errorf("estimate %v, want about %v", e.RelMSE, want)
	}
}

func TestUnequalHalves(t *testing.T) {
	// One sample in half 0 for every three in half 1; the expected estimate is the variance of the
	// weighted mean: s / n with s the variance of one sample.
	random := rand.New(rand.NewPCG(2, 2))
	const n, mean, s = 64 * 64 * 3, 5.0, 0.4
	images := develop.Images{Shape: film.Shape{Width: 64, Height: 64, Layers: 1}, Weights: [2]float64{0.25, 0.75}}
	for h, samples := range []float64{1, 3} {
		images.Halves[h] = make([]float64, n)
		for i := range images.Halves[h] {
			images.Halves[h][i] = mean + math.Sqrt(s/samples)*random.NormFloat64()
		}
	}
	e := convergence.Of(images, [film.StatGroups][]float64{}, develop.Scales{})
	if want := s / 4 / (mean * mean * 1.01); math.Abs(e.RelMSE/want-1) > 6*math.Sqrt(2.0/n)+0.03 {
		t.Errorf("estimate %v, want about %v", e.RelMSE, want)
	}
}

func TestBlackAndUnknown(t *testing.T) {
	black := develop.Images{Shape: film.Shape{Width: 1, Height: 1, Layers: 1}, Weights: [2]float64{0.5, 0.5}}
	black.Halves = [2][]float64{make([]float64, 3), make([]float64, 3)}
	if e := convergence.Of(black, [film.StatGroups][]float64{}, develop.Scales{}); e.RelMSE != 0 || !e.Known {
		t.Errorf("black: %+v", e)
	}
	black.Weights = [2]float64{1, 0}
	if e := convergence.Of(black, [film.StatGroups][]float64{}, develop.Scales{}); e.Known {
		t.Errorf("one half: %+v", e)
	}
}

// TestMeasureRatio repeats the measurement that TestEstimateOnRareFeatures cites.
func TestMeasureRatio(t *testing.T) {
	if os.Getenv("METROFARM_MEASURE") == "" {
		t.Skip("a measurement: set METROFARM_MEASURE=1")
	}
	const repeats = 20
	sum, squares, inside := 0.0, 0.0, 0.0
	for i := range repeats {
		ratio, in := measure(uint64(i+10), 40)
		l := math.Log(ratio)
		sum, squares, inside = sum+l/repeats, squares+l*l/repeats, inside+in/repeats
	}
	t.Logf("log ratio: mean %.3f, standard deviation %.3f; inside the interval %.2f", sum, math.Sqrt(squares-sum*sum), inside)
}
