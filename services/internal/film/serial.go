package film

import (
	"encoding/binary"
	"fmt"
	"io"
)

// endOfTiles closes a serialized film; no tile has this index.
const endOfTiles = ^uint64(0)

// Write writes the film in canonical form: width, height and layers, then every tile that is not
// all zero, in index order, as its index and its values (low word, high word), and an end mark; all
// as little-endian 64-bit words. Equal films give equal bytes, whatever was allocated on the way.
func (f *Film) Write(w io.Writer) error {
	buffer := make([]byte, 0, FullTileValues*16+8)
	for _, n := range []int{f.shape.Width, f.shape.Height, f.shape.Layers} {
		buffer = binary.LittleEndian.AppendUint64(buffer, uint64(n))
	}
	for index, s := range f.tiles {
		if s == nil || s.zero() {
			continue
		}
		buffer = s.append(binary.LittleEndian.AppendUint64(buffer, uint64(index)))
		if _, err := w.Write(buffer); err != nil {
			return fmt.Errorf("film: write: %w", err)
		}
		buffer = buffer[:0]
	}
	buffer = binary.LittleEndian.AppendUint64(buffer, endOfTiles)
	if _, err := w.Write(buffer); err != nil {
		return fmt.Errorf("film: write: %w", err)
	}
	return nil
}

// Read reads what Write wrote.
func Read(r io.Reader) (*Film, error) {
	var header [3]uint64
	if err := binary.Read(r, binary.LittleEndian, &header); err != nil {
		return nil, fmt.Errorf("film: read: %w", err)
	}
	shape := Shape{Width: int(header[0]), Height: int(header[1]), Layers: int(header[2])}
	if err := shape.Validate(); err != nil {
		return nil, err
	}
	f := New(shape)
	for {
		done, err := f.readTile(r)
		if err != nil || done {
			return f, err
		}
	}
}

func (f *Film) readTile(r io.Reader) (done bool, err error) {
	var word [8]byte
	if _, err := io.ReadFull(r, word[:]); err != nil {
		return false, fmt.Errorf("film: read: %w", err)
	}
	index := binary.LittleEndian.Uint64(word[:])
	if index == endOfTiles {
		return true, nil
	}
	if index >= uint64(len(f.tiles)) || f.tiles[index] != nil {
		return false, fmt.Errorf("film: read: tile %d is out of range or repeated", index)
	}
	values := f.shape.region(f.shape.address(int(index))).values()
	buffer := make([]byte, values*16)
	if _, err := io.ReadFull(r, buffer); err != nil {
		return false, fmt.Errorf("film: read: %w", err)
	}
	s := &sums{lo: make([]uint64, values), hi: make([]int64, values)}
	for i := range values {
		s.lo[i] = binary.LittleEndian.Uint64(buffer[i*16:])
		s.hi[i] = int64(binary.LittleEndian.Uint64(buffer[i*16+8:]))
	}
	f.tiles[index] = s
	return false, nil
}

func (s *sums) zero() bool {
	for i := range s.lo {
		if s.lo[i] != 0 || s.hi[i] != 0 {
			return false
		}
	}
	return true
}

func (s *sums) append(buffer []byte) []byte {
	for i := range s.lo {
		buffer = binary.LittleEndian.AppendUint64(buffer, s.lo[i])
		buffer = binary.LittleEndian.AppendUint64(buffer, uint64(s.hi[i]))
	}
	return buffer
}
