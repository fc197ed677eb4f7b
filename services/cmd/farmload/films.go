package main

import (
	"fmt"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/plan"
)

// template is a film, packed, that becomes one of any digest by changing a single value: a digest is
// linear in the values, and its factors are odd, so that one value modulo 2^64 sets it as a whole.
type template struct {
	shape   film.Shape
	codec   *film.Codec
	tiles   []*farmv1.Tile // all but the first tile of the first plane
	first   []int64        // the values of that tile
	digest  uint64         // of all of it
	inverse uint64         // of what the digest changes by when the first value grows by 1
	size    filmSize
}

// filmSize is what a film weighs.
type filmSize struct {
	Width         int     `json:"width"`
	Height        int     `json:"height"`
	Mutations     uint64  `json:"mutations"`
	RenderCPU     float64 `json:"render_cpu_seconds"`
	Tiles         int     `json:"tiles"`
	TilesShare    float64 `json:"share_of_tiles"`
	NonZeroShare  float64 `json:"share_of_values_not_zero"`
	PackedBytes   int     `json:"packed_bytes"`
	UnpackedBytes int     `json:"unpacked_bytes"`
	StateBytes    int     `json:"state_bytes_per_segment"`
}

// newTemplate adds up the first sum batches of a recording, which is what a worker that seals that
// much more rarely would deliver.
func newTemplate(r *recording, sum int) (*template, error) {
	if sum < 1 || sum > len(r.batches) {
		return nil, fmt.Errorf("-sum: %d, and the recording holds %d batches", sum, len(r.batches))
	}
	codec, err := film.NewCodec()
	if err != nil {
		return nil, err
	}
	t := &template{shape: plan.Shape(r.spec), codec: codec}
	t.size.Width, t.size.Height = t.shape.Width, t.shape.Height
	values := map[film.Address][]int64{{}: make([]int64, film.FullTileValues)}
	for _, b := range r.batches[:sum] {
		if err := t.add(values, b); err != nil {
			return nil, err
		}
	}
	if err := t.pack(values); err != nil {
		return nil, err
	}
	factor := t.shape.SplatDigest(false, 0, 0, 0, 1)
	t.inverse = factor
	for range 6 { // Newton: each step doubles the number of right bits, of which an odd number has 3
		t.inverse *= 2 - factor*t.inverse
	}
	return t, nil
}

func (t *template) add(sums map[film.Address][]int64, b recordedBatch) error {
	for _, packed := range b.tiles {
		decoded, _, err := t.codec.DecodeTile(t.shape, packed)
		if err != nil {
			return err
		}
		at := film.Address{Low: packed.GetLow(), Plane: int(packed.GetPlane()), X: int(packed.GetX()), Y: int(packed.GetY())}
		if sums[at] == nil {
			sums[at] = make([]int64, len(decoded.Values))
		}
		for i, v := range decoded.Values {
			sums[at][i] += v
		}
	}
	t.size.RenderCPU += b.header.GetCpuSeconds()
	for _, s := range b.header.GetSegments() {
		t.size.Mutations += s.GetCounts().GetMutations()
		t.size.StateBytes = max(t.size.StateBytes, len(s.GetState()))
	}
	return nil
}

func (t *template) pack(sums map[film.Address][]int64) error {
	all, set := 0, 0
	for at, values := range sums {
		packed := t.codec.EncodeTile(at, values)
		_, digest, err := t.codec.DecodeTile(t.shape, packed)
		if err != nil {
			return err
		}
		t.digest += digest
		all += len(values)
		for _, v := range values {
			if v != 0 {
				set++
			}
		}
		t.size.PackedBytes += len(packed.GetData())
		if (at == film.Address{}) {
			t.first = values
			continue
		}
		t.tiles = append(t.tiles, packed)
	}
	t.size.Tiles = len(sums)
	t.size.TilesShare = float64(len(sums)) / float64(t.shape.TileCount())
	t.size.UnpackedBytes = all * 8
	t.size.NonZeroShare = float64(set) / float64(all)
	return nil
}

// of returns the film with this digest. It may be called by several goroutines.
func (t *template) of(digest uint64) []*farmv1.Tile {
	values := append([]int64(nil), t.first...)
	values[0] += int64((digest - t.digest) * t.inverse)
	tiles := make([]*farmv1.Tile, 0, len(t.tiles)+1)
	return append(append(tiles, t.codec.EncodeTile(film.Address{}, values)), t.tiles...)
}
