package checkpoint

import (
	"bytes"
	"errors"
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

// sample is a state with one dark half, one counted segment in an open round and one ahead of it.
func sample(t *testing.T) *render.State {
	t.Helper()
	spec := &jobv1.ResolvedSpec{
		Integrator: jobv1.Integrator_INTEGRATOR_PSSMLT, Width: 40, Height: 20, GroupSize: 2, ChainGroups: 16,
		Unit: 0.3, RoundSizes: []uint64{5, 5, 5},
	}
	seeds := make([][]bootstrap.Seed, 16)
	for g := 1; g < 16; g += 2 {
		seeds[g] = []bootstrap.Seed{{Index: 3, Value: 0.1}, {Index: 4, Value: 0.2}}
	}
	s := render.New(spec, 800, [2]tally.Sums{{Count: 4}, {Count: 4, Sum: 0.1, SumSquares: 0.3}}, seeds)
	for number := range 2 {
		batch := &merge.Batch{Round: number, CPUSeconds: 0.1, Segments: []merge.Segment{{
			Entry:  round.Entry{Segment: 3, Mark: round.Mark{Digest: 9}},
			Counts: tally.Counts{Mutations: 10, LargeSteps: 4, SmallSteps: 6},
			State:  []byte{1, byte(number)},
			Sums:   []tally.Sums{{Count: 2, Sum: 0.7}, {Count: 2, Sum: 1.0 / 3}},
		}}}
		values := make([]int64, film.FullTileValues)
		values[5] = -77
		batch.Tiles = []film.Tile{{Index: 1, Values: values}}
		if verdict, err := s.Judge(batch); err != nil || verdict != round.Fresh {
			t.Fatalf("verdict %v, error %v", verdict, err)
		}
		s.Commit(batch)
	}
	return s
}

func write(t *testing.T, c Checkpoint) []byte {
	t.Helper()
	var b bytes.Buffer
	if err := Write(&b, c); err != nil {
		t.Fatal(err)
	}
	return b.Bytes()
}

func TestRoundTrip(t *testing.T) {
	want := Checkpoint{State: sample(t), Extra: Extra{WallSeconds: 1.5, Report: []byte{8}}}
	content := write(t, want)
	got, err := Read(bytes.NewReader(content))
	if err != nil {
		t.Fatal(err)
	}
	if !bytes.Equal(write(t, got), content) {
		t.Error("what was read writes other bytes")
	}
	if got.Extra.WallSeconds != 1.5 || len(got.State.Open) != 2 || !got.State.Open[1].Ledger.Counted[3] ||
		got.State.Open[0].States[3][0] != 1 || got.State.Ready(0, 2) || !got.State.Ready(0, 1) || !got.State.Open[0].Ledger.Expected[1] {
		t.Errorf("%+v", got.State)
	}
}

func TestDamageIsNoticed(t *testing.T) {
	content := write(t, Checkpoint{State: sample(t)})
	for cut := 0; cut < len(content); cut += 1 + len(content)/50 {
		if _, err := Read(bytes.NewReader(content[:cut])); !errors.Is(err, ErrCorrupt) {
			t.Errorf("cut at %d: %v", cut, err)
		}
		flipped := bytes.Clone(content)
		flipped[cut] ^= 4
		if _, err := Read(bytes.NewReader(flipped)); !errors.Is(err, ErrCorrupt) {
			t.Errorf("flipped at %d: %v", cut, err)
		}
	}
}
