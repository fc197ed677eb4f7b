package render

import (
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

func pathState(width, height uint32) *State {
	spec := &jobv1.ResolvedSpec{
		Integrator: jobv1.Integrator_INTEGRATOR_PATH, Width: width, Height: height, GroupSize: 64,
		BlocksPerSegment: 1, Unit: 2, RoundSizes: []uint64{2, 3},
	}
	return New(spec, int(width*height), [2]tally.Sums{}, nil)
}

func segment(s *State, number, index int) *merge.Batch {
	n := uint64(min(64, s.Cells-index*64)) * s.Spec.RoundSizes[number]
	values := make([]int64, film.FullTileValues)
	values[index] = int64(index+1) << 32
	return &merge.Batch{Round: number, Tiles: []film.Tile{{Index: 0, Values: values}}, Segments: []merge.Segment{{
		Entry: round.Entry{Segment: index, Mark: round.Mark{Digest: uint64(index + 1)}}, Counts: tally.Counts{Mutations: n},
	}}}
}

func deliver(t *testing.T, s *State, number, index int, want round.Verdict) {
	t.Helper()
	b := segment(s, number, index)
	verdict, err := s.Judge(b)
	if err != nil || verdict != want {
		t.Fatalf("round %d segment %d: verdict %v, error %v", number, index, verdict, err)
	}
	if verdict == round.Fresh {
		s.Commit(b)
	}
}

func fold(t *testing.T, s *State) {
	t.Helper()
	snapshot := s.Snapshot()
	if err := snapshot.Fold(); err != nil {
		t.Fatal(err)
	}
	point, err := snapshot.Evaluate()
	if err != nil {
		t.Fatal(err)
	}
	snapshot.Points = append(snapshot.Points, point)
	s.Adopt(snapshot)
}

// TestRunAheadGivesTheSameFilm delivers round 1 before, while and after round 0 is folded.
func TestRunAheadGivesTheSameFilm(t *testing.T) {
	var films []string
	for ahead := range 3 {
		s := pathState(16, 8)
		for index := range ahead {
			deliver(t, s, 1, index, round.Fresh)
		}
		deliver(t, s, 0, 1, round.Fresh)
		deliver(t, s, 0, 0, round.Fresh)
		fold(t, s)
		for index := ahead; index < 2; index++ {
			deliver(t, s, 1, index, round.Fresh)
		}
		fold(t, s)
		films = append(films, s.Points[1].FilmSHA256)
	}
	if films[0] != films[1] || films[1] != films[2] {
		t.Errorf("films %v", films)
	}
}

func TestLateDuplicatesAndForeignRounds(t *testing.T) {
	s := pathState(16, 8)
	deliver(t, s, 0, 0, round.Fresh)
	deliver(t, s, 0, 0, round.Duplicate)
	deliver(t, s, 0, 1, round.Fresh)
	fold(t, s)
	deliver(t, s, 0, 1, round.Duplicate)
	conflicting := segment(s, 0, 1)
	conflicting.Segments[0].Mark.Digest = 99
	if verdict, err := s.Judge(conflicting); err != nil || verdict != round.Conflict {
		t.Errorf("verdict %v, error %v", verdict, err)
	}
	for name, b := range map[string]*merge.Batch{"round 2": {Round: 2, Segments: segment(s, 1, 0).Segments}, "miscounted": segment(s, 1, 0)} {
		b.Segments[0].Counts.Mutations++
		if _, err := s.Judge(b); err == nil {
			t.Errorf("%s was accepted", name)
		}
	}
}

// BenchmarkFullHD is what a complete round of a dense 1920 x 1080 PSSMLT film costs.
func BenchmarkFullHD(b *testing.B) {
	spec := &jobv1.ResolvedSpec{
		Integrator: jobv1.Integrator_INTEGRATOR_PSSMLT, Width: 1920, Height: 1080, GroupSize: 64, ChainGroups: 16,
		Unit: 2, RoundSizes: []uint64{2, 3},
	}
	s := New(spec, 1920*1080, [2]tally.Sums{}, make([][]bootstrap.Seed, 16))
	values := make([]int64, film.FullTileValues)
	for i := range values {
		values[i] = int64(i) << 30
	}
	tiles := film.Shape{Width: 1920, Height: 1080, Layers: 2}.TileCount() - 32
	add := func() {
		for index := range tiles {
			s.Open[0].Film.Add(film.Tile{Index: index, Values: values})
		}
	}
	add()
	b.Run("merge", func(b *testing.B) {
		for b.Loop() {
			add()
		}
	})
	b.Run("fold", func(b *testing.B) {
		for b.Loop() {
			if err := s.Snapshot().Fold(); err != nil {
				b.Fatal(err)
			}
		}
	})
	folded := s.Snapshot()
	_ = folded.Fold()
	b.Run("evaluate", func(b *testing.B) {
		for b.Loop() {
			if _, err := folded.Evaluate(); err != nil {
				b.Fatal(err)
			}
		}
	})
}
