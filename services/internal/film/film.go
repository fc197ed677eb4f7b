package film

import (
	"fmt"
	"math/bits"
	"slices"
)

// FixedOne is the integer that stands for one film unit.
const FixedOne = 1 << 32

// Tile is the decoded content of one tile of a batch: values channel by channel, row by row.
type Tile struct {
	Index  int // canonical, see Shape.Index
	Values []int64
}

// sums are the 128-bit values of one tile, two's complement. A frozen tile is shared with a
// snapshot and is copied before it changes.
type sums struct {
	lo     []uint64
	hi     []int64
	frozen bool
}

// freeze writes only once, so that snapshots which share a tile may freeze it concurrently.
func (s *sums) freeze() {
	if !s.frozen {
		s.frozen = true
	}
}

// Film is a sum of batches.
type Film struct {
	shape Shape
	tiles []*sums // by canonical index; nil where nothing arrived
}

// New returns a film of zeros.
func New(shape Shape) *Film {
	return &Film{shape: shape, tiles: make([]*sums, shape.TileCount())}
}

// Shape of the film.
func (f *Film) Shape() Shape { return f.shape }

// Add adds a tile. Requires: t was checked against this film's shape (see DecodeTile).
func (f *Film) Add(t Tile) {
	s := f.writable(t.Index, len(t.Values))
	lows, highs := s.lo[:len(t.Values)], s.hi[:len(t.Values)]
	for i, v := range t.Values {
		lo, carry := bits.Add64(lows[i], uint64(v), 0)
		lows[i] = lo
		highs[i] += v>>63 + int64(carry)
	}
}

// AddFilm adds another film of the same shape, whose tiles it may share from then on.
func (f *Film) AddFilm(other *Film) error {
	if f.shape != other.shape {
		return fmt.Errorf("film: adding %+v to %+v", other.shape, f.shape)
	}
	for index, theirs := range other.tiles {
		switch {
		case theirs == nil:
		case f.tiles[index] == nil:
			theirs.freeze()
			f.tiles[index] = theirs
		default:
			f.addSums(index, theirs)
		}
	}
	return nil
}

func (f *Film) addSums(index int, theirs *sums) {
	ours := f.writable(index, len(theirs.lo))
	for i := range theirs.lo {
		lo, carry := bits.Add64(ours.lo[i], theirs.lo[i], 0)
		ours.lo[i] = lo
		ours.hi[i] += theirs.hi[i] + int64(carry)
	}
}

func (f *Film) writable(index, values int) *sums {
	s := f.tiles[index]
	switch {
	case s == nil:
		s = &sums{lo: make([]uint64, values), hi: make([]int64, values)}
	case s.frozen:
		s = &sums{lo: slices.Clone(s.lo), hi: slices.Clone(s.hi)}
	default:
		return s
	}
	f.tiles[index] = s
	return s
}

// Snapshot returns the film as it is now. It shares tiles with the film until the film changes
// them, and may be read while the film goes on. It must not be added to.
func (f *Film) Snapshot() *Film {
	for _, s := range f.tiles {
		if s != nil {
			s.freeze()
		}
	}
	return &Film{shape: f.shape, tiles: slices.Clone(f.tiles)}
}

// Bytes is the memory that the film's sums take.
func (f *Film) Bytes() int64 {
	var n int64
	for _, s := range f.tiles {
		if s != nil {
			n += int64(len(s.lo)) * 16
		}
	}
	return n
}

// AddPlane adds scale times a full-resolution plane, in film units, to dst: 3 values per pixel, row
// by row. Requires: len(dst) is 3 * width * height.
func (f *Film) AddPlane(dst []float64, plane int, scale float64) {
	perPlane := f.shape.TilesX() * f.shape.TilesY()
	for index := plane * perPlane; index < (plane+1)*perPlane; index++ {
		s := f.tiles[index]
		if s == nil {
			continue
		}
		a := f.shape.address(index)
		r := f.shape.region(a)
		for row := range r.height {
			at := ((a.Y*TileSize+row)*f.shape.Width + a.X*TileSize) * Channels
			for column := range r.width {
				for c := range Channels {
					i := (c*TileSize+row)*TileSize + column
					dst[at+column*Channels+c] += scale * toFloat(s.hi[i], s.lo[i])
				}
			}
		}
	}
}

// AddLowPlane adds scale times a low-resolution plane, in film units, to dst: 3 values per cell,
// 16 x 16 cells, row by row.
func (f *Film) AddLowPlane(dst []float64, plane int, scale float64) {
	s := f.tiles[f.shape.FullPlanes()*f.shape.TilesX()*f.shape.TilesY()+plane]
	if s == nil {
		return
	}
	for cell := range LowSize * LowSize {
		for c := range Channels {
			i := c*LowSize*LowSize + cell
			dst[cell*Channels+c] += scale * toFloat(s.hi[i], s.lo[i])
		}
	}
}

// toFloat is the value in film units. Both words convert with one rounding each, so the relative
// error stays within 2^-52 whatever the magnitude.
func toFloat(hi int64, lo uint64) float64 {
	negative := hi < 0
	if negative {
		var borrow uint64
		lo, borrow = bits.Sub64(0, lo, 0)
		hi = -hi - int64(borrow)
	}
	v := (float64(uint64(hi))*(1<<32)*(1<<32) + float64(lo)) / FixedOne
	if negative {
		return -v
	}
	return v
}
