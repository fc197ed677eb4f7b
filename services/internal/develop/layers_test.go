package develop

import (
	"math"
	"testing"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/tally"
)

// put adds values to the first pixel of a full plane.
func put(t *testing.T, f *film.Film, plane int, rgb [3]float64) {
	t.Helper()
	values := make([]int64, film.FullTileValues)
	for c, v := range rgb {
		values[c*film.TileSize*film.TileSize] = int64(v * film.FixedOne)
	}
	index, err := f.Shape().Index(film.Address{Plane: plane})
	if err != nil {
		t.Fatal(err)
	}
	f.Add(film.Tile{Index: index, Values: values})
}

func TestAcceptanceMap(t *testing.T) {
	f := film.New(film.Shape{Width: 2, Height: 1, Layers: 3})
	put(t, f, 2, [3]float64{30, 6, 9})
	put(t, f, 5, [3]float64{10, 2, 1})
	layer := AcceptanceMap(f, 2, 6, 120)
	want := []float32{2, 0.2, 0.25, 0, 0, 0}
	for i, v := range layer.Values {
		if v != want[i] {
			t.Errorf("value %d is %v, want %v", i, v, want[i])
		}
	}
	if layer.Name != "acceptance" || layer.Channels[1] != "accepted" {
		t.Errorf("layer %s, channels %v", layer.Name, layer.Channels)
	}
}

// TestTechniquesSumToTheImage: what is put into the image's layers is put into those of a technique.
func TestTechniquesSumToTheImage(t *testing.T) {
	const layers, first, count = 13, 3, 5
	f := film.New(film.Shape{Width: 2, Height: 1, Layers: layers})
	for technique := range count {
		for half := range film.Halves {
			for l := range 2 {
				rgb := [3]float64{float64(1 + technique), float64(2 + half), float64(3 + l)}
				put(t, f, half*layers+l, rgb)
				put(t, f, half*layers+first+2*technique+l, rgb)
			}
		}
	}
	totals := ChainTotals{Cells: 2, Unit: 3, Samples: [2]tally.Sums{{Count: 1, Sum: 2}, {Count: 1, Sum: 5}}}
	for g := range film.StatGroups {
		totals.Mutations[g], totals.LargeSteps[g] = 7, 2
	}
	scales := PSSMLT(totals)
	images := Develop(f, scales)
	sums := make([]float64, 6)
	for s, layer := range Techniques(f, scales, first, count) {
		if layer.Name != "technique.s"+string(rune('0'+s)) {
			t.Errorf("layer %d is %s", s, layer.Name)
		}
		for i, v := range layer.Values {
			sums[i] += float64(v)
		}
	}
	for i, sum := range sums {
		if want := images.Mean(i); math.Abs(sum-want) > 1e-6*want {
			t.Errorf("value %d sums to %v, not %v", i, sum, want)
		}
	}
}
