package film

import (
	"encoding/binary"
	"errors"
	"fmt"
	"sync"

	"github.com/klauspost/compress/zstd"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// ErrMalformed: a tile that no correct worker sends.
var ErrMalformed = errors.New("malformed tile")

// Codec packs and unpacks tiles. It may be used by several goroutines.
type Codec struct {
	decoder *zstd.Decoder
	encoder *zstd.Encoder
	raw     sync.Pool // of *[]byte: where tiles are unpacked to
}

// NewCodec returns a codec whose decoder refuses frames that would unpack to more than one tile.
func NewCodec() (*Codec, error) {
	// The output limit of DecodeAll is the capacity of its destination, which DecodeTile sets to the
	// exact size; the memory limit bounds the window that a frame may ask for.
	decoder, err := zstd.NewReader(nil, zstd.WithDecodeAllCapLimit(true), zstd.WithDecoderMaxMemory(8<<20))
	if err != nil {
		return nil, fmt.Errorf("film: %w", err)
	}
	encoder, err := zstd.NewWriter(nil, zstd.WithEncoderLevel(zstd.SpeedFastest), zstd.WithEncoderConcurrency(1))
	if err != nil {
		return nil, fmt.Errorf("film: %w", err)
	}
	c := &Codec{decoder: decoder, encoder: encoder}
	c.raw.New = func() any { return new(make([]byte, FullTileValues*8)) }
	return c, nil
}

// DecodeTile checks a tile against the shape and returns its values and its part of the batch
// digest. All errors are ErrMalformed.
func (c *Codec) DecodeTile(shape Shape, t *farmv1.Tile) (Tile, uint64, error) {
	a := Address{Low: t.GetLow(), Plane: int(t.GetPlane()), X: int(t.GetX()), Y: int(t.GetY())}
	index, err := shape.Index(a)
	if err != nil {
		return Tile{}, 0, fmt.Errorf("%w: %w", ErrMalformed, err)
	}
	r := shape.region(a)
	size := r.values() * 8
	buffer := c.raw.Get().(*[]byte) // only New fills it
	defer c.raw.Put(buffer)
	raw, err := c.decoder.DecodeAll(t.GetData(), (*buffer)[:0:size])
	if err != nil {
		return Tile{}, 0, fmt.Errorf("%w: %+v: %w", ErrMalformed, a, err)
	}
	if len(raw) != size {
		return Tile{}, 0, fmt.Errorf("%w: %+v: %d bytes, not %d", ErrMalformed, a, len(raw), size)
	}
	values := unshuffle(raw)
	if !r.zeroOutside(values) {
		return Tile{}, 0, fmt.Errorf("%w: %+v: values outside the image", ErrMalformed, a)
	}
	return Tile{Index: index, Values: values}, shape.tileDigest(a, values), nil
}

// EncodeTile packs values for the wire.
func (c *Codec) EncodeTile(a Address, values []int64) *farmv1.Tile {
	return &farmv1.Tile{
		Low: a.Low, Plane: uint32(a.Plane), X: uint32(a.X), Y: uint32(a.Y),
		Data: c.encoder.EncodeAll(shuffle(values), nil),
	}
}

func (r region) zeroOutside(values []int64) bool {
	if r.width == r.side && r.height == r.side {
		return true
	}
	for i, v := range values {
		column, row := i%r.side, i/r.side%r.side
		if v != 0 && (column >= r.width || row >= r.height) {
			return false
		}
	}
	return true
}

// shuffle puts all lowest bytes first, up to all highest: neighbours share their high bytes, so the
// planes compress well.
func shuffle(values []int64) []byte {
	n := len(values)
	out := make([]byte, 8*n)
	for i, v := range values {
		for k := range 8 {
			out[k*n+i] = byte(v >> (8 * k))
		}
	}
	return out
}

// unshuffle is the inverse. Both sizes of tiles are multiples of 8, so it takes 8 values at a time;
// where there was no light they are all zero.
func unshuffle(raw []byte) []int64 {
	n := len(raw) / 8
	values := make([]int64, n)
	for i := 0; i < n; i += 8 {
		var block [8]uint64
		any := uint64(0)
		for k := range block {
			block[k] = binary.LittleEndian.Uint64(raw[k*n+i:])
			any |= block[k]
		}
		if any == 0 {
			continue
		}
		transpose(&block)
		for k, v := range block {
			values[i+k] = int64(v)
		}
	}
	return values
}

// transpose makes byte k of word i byte i of word k: it exchanges the off-diagonal quarters of the
// square of 8 x 8 bytes, then those of each quarter, then those of each of their quarters.
func transpose(block *[8]uint64) {
	for k := range 4 {
		exchange(&block[k], &block[k+4], 32, 0x00000000ffffffff)
	}
	for _, k := range [4]int{0, 1, 4, 5} {
		exchange(&block[k], &block[k+2], 16, 0x0000ffff0000ffff)
	}
	for k := 0; k < 8; k += 2 {
		exchange(&block[k], &block[k+1], 8, 0x00ff00ff00ff00ff)
	}
}

// exchange the bits of a above shift, as far as the mask goes, with those of b below it.
func exchange(a, b *uint64, shift int, mask uint64) {
	t := (*a>>shift ^ *b) & mask
	*a ^= t << shift
	*b ^= t
}
