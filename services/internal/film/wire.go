package film

import (
	"errors"
	"fmt"

	"github.com/klauspost/compress/zstd"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// ErrMalformed: a tile that no correct worker sends.
var ErrMalformed = errors.New("malformed tile")

// Codec packs and unpacks tiles. It may be used by several goroutines.
type Codec struct {
	decoder *zstd.Decoder
	encoder *zstd.Encoder
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
	return &Codec{decoder: decoder, encoder: encoder}, nil
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
	raw, err := c.decoder.DecodeAll(t.GetData(), make([]byte, 0, size))
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

func unshuffle(raw []byte) []int64 {
	n := len(raw) / 8
	values := make([]int64, n)
	for k := range 8 {
		plane := raw[k*n : (k+1)*n]
		for i, b := range plane {
			values[i] |= int64(b) << (8 * k)
		}
	}
	return values
}
