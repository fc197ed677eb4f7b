package merge

import (
	"errors"
	"math"
	"reflect"
	"testing"

	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/film"
)

var shape = film.Shape{Width: 64, Height: 32, Layers: 2}

func codec(t *testing.T) *film.Codec {
	t.Helper()
	c, err := film.NewCodec()
	if err != nil {
		t.Fatal(err)
	}
	return c
}

// batch of two segments with one splat each.
func batch(c *film.Codec) (*farmv1.BatchHeader, []*farmv1.Tile) {
	values := make([]int64, film.FullTileValues)
	values[0], values[1] = 5, -3
	first, second := shape.SplatDigest(false, 1, 0, 0, 5), shape.SplatDigest(false, 1, 1, 0, -3)
	segment := func(number uint32, digest uint64) *farmv1.SegmentResult {
		return &farmv1.SegmentResult{
			Segment: number, Digest: digest, State: []byte{1},
			Counts:        &farmv1.SegmentCounts{Mutations: 10, Rays: 20},
			LargeStepSums: []*farmv1.LargeStepSums{{Count: 1, Sum: 0.5, SumSquares: 0.25}},
		}
	}
	header := &farmv1.BatchHeader{
		JobId: "j", Segments: []*farmv1.SegmentResult{segment(0, first), segment(4, second)},
		Digest: first + second, TileCount: 1,
	}
	return header, []*farmv1.Tile{c.EncodeTile(film.Address{Plane: 1}, values)}
}

func assemble(c *film.Codec, h *farmv1.BatchHeader, tiles []*farmv1.Tile) (*Batch, error) {
	a, err := NewAssembler(c, shape, 1, h)
	if err != nil {
		return nil, err
	}
	if err := a.Add(tiles); err != nil {
		return nil, err
	}
	return a.Finish()
}

func TestAssemble(t *testing.T) {
	c := codec(t)
	got, err := assemble(c, first(batch(c)), second(batch(c)))
	if err != nil {
		t.Fatal(err)
	}
	if len(got.Tiles) != 1 || got.Tiles[0].Values[1] != -3 || len(got.Segments) != 2 || got.Segments[1].Segment != 4 {
		t.Errorf("%+v", got)
	}
}

func TestPackedBatchIsTheSameUnpacked(t *testing.T) {
	c := codec(t)
	got, err := assemble(c, first(batch(c)), second(batch(c)))
	if err != nil {
		t.Fatal(err)
	}
	before := got.Tiles
	if bytes := got.Pack(); bytes == 0 || bytes >= 8*film.FullTileValues || got.Tiles != nil {
		t.Errorf("packed into %d bytes and %d tiles", bytes, len(got.Tiles))
	}
	if err := got.Unpack(c, shape); err != nil || !reflect.DeepEqual(got.Tiles, before) {
		t.Errorf("%d tiles, error %v", len(got.Tiles), err)
	}
}

func first(h *farmv1.BatchHeader, _ []*farmv1.Tile) *farmv1.BatchHeader { return h }
func second(_ *farmv1.BatchHeader, t []*farmv1.Tile) []*farmv1.Tile     { return t }

func TestRefusals(t *testing.T) {
	c := codec(t)
	for name, k := range map[string]struct {
		damage func(*farmv1.BatchHeader, []*farmv1.Tile) []*farmv1.Tile
		want   error
	}{
		"tile missing":  {func(_ *farmv1.BatchHeader, _ []*farmv1.Tile) []*farmv1.Tile { return nil }, ErrDamaged},
		"tile too many": {func(_ *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile { return append(tiles, tiles[0]) }, ErrDamaged},
		"tile twice": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.TileCount = 2
			return append(tiles, tiles[0])
		}, ErrDamaged},
		"tile cut short": {func(_ *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			tiles[0].Data = tiles[0].Data[:len(tiles[0].Data)/2]
			return tiles
		}, ErrDamaged},
		"tile elsewhere": {func(_ *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			tiles[0].X = 1 << 20
			return tiles
		}, ErrDamaged},
		"tile count": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.TileCount = math.MaxUint32
			return tiles
		}, ErrMalformed},
		"header digest":  {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile { h.Digest++; return tiles }, ErrDigest},
		"segment digest": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile { h.Segments[0].Digest++; return tiles }, ErrDigest},
		"all digests": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.Digest++
			h.Segments[0].Digest++
			return tiles
		}, ErrDigest},
		"no segments": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile { h.Segments = nil; return tiles }, ErrMalformed},
		"no state": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.Segments[0].State = nil
			return tiles
		}, ErrMalformed},
		"sums missing": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.Segments[0].LargeStepSums = nil
			return tiles
		}, ErrMalformed},
		"sum not finite": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.Segments[0].LargeStepSums[0].Sum = math.NaN()
			return tiles
		}, ErrMalformed},
		"anomaly kinds": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.Segments[0].Counts.Anomalies = make([]uint64, 6)
			return tiles
		}, ErrMalformed},
		"anomaly samples": {func(h *farmv1.BatchHeader, tiles []*farmv1.Tile) []*farmv1.Tile {
			h.Anomalies = make([]*farmv1.Anomaly, 17)
			return tiles
		}, ErrMalformed},
	} {
		header, tiles := batch(c)
		tiles = k.damage(header, tiles)
		if _, err := assemble(c, header, tiles); !errors.Is(err, k.want) {
			t.Errorf("%s: %v", name, err)
		}
	}
}

func TestEvidenceTellsReportsApart(t *testing.T) {
	c := codec(t)
	header, tiles := batch(c)
	want, err := assemble(c, header, tiles)
	if err != nil {
		t.Fatal(err)
	}
	for name, change := range map[string]func(*farmv1.SegmentResult){
		"state":  func(s *farmv1.SegmentResult) { s.State = []byte{2} },
		"counts": func(s *farmv1.SegmentResult) { s.Counts.Rays++ },
		"sums":   func(s *farmv1.SegmentResult) { s.LargeStepSums[0].SumSquares *= 2 },
	} {
		other := proto.CloneOf(header)
		change(other.Segments[0])
		got, err := assemble(c, other, tiles)
		if err != nil {
			t.Fatal(err)
		}
		if got.Segments[0].Mark == want.Segments[0].Mark || got.Segments[1].Mark != want.Segments[1].Mark {
			t.Errorf("%s: marks do not tell", name)
		}
	}
}
