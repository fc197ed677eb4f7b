package main

import (
	"encoding/binary"
	"errors"
	"fmt"
	"math"
	"math/rand/v2"
	"slices"

	"github.com/klauspost/compress/zstd"
	"google.golang.org/protobuf/proto"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// parcel is a delivery as a whole. Its messages are never changed, only replaced.
type parcel struct {
	header *farmv1.DeliverHeader
	tiles  []*farmv1.DeliverTiles
}

func (x parcel) clone() parcel {
	y := parcel{header: proto.CloneOf(x.header)}
	for _, tiles := range x.tiles {
		y.tiles = append(y.tiles, proto.CloneOf(tiles))
	}
	return y
}

func (x parcel) places() []place {
	var places []place
	for _, s := range x.header.GetBatch().GetSegments() {
		places = append(places, place{x.header.GetBatch().GetRound(), s.GetSegment()})
	}
	return places
}

func (x parcel) all() []*farmv1.Tile {
	var all []*farmv1.Tile
	for _, tiles := range x.tiles {
		all = append(all, tiles.GetTiles()...)
	}
	return all
}

// hasStates tells whether the segments are those of chains.
func (x parcel) hasStates() bool {
	segments := x.header.GetBatch().GetSegments()
	return len(segments) > 0 && len(segments[0].GetState()) > 0
}

// damaged returns the parcel with a fault in it, and says where. flipState needs states.
func damaged(x parcel, f fault, random *rand.Rand) (parcel, string, error) {
	x = x.clone()
	tiles := x.all()
	if len(tiles) == 0 && slices.Contains([]fault{truncate, flipPacked, flipValue}, f) {
		f = flipDigest // a black film has no tiles
	}
	segments := x.header.GetBatch().GetSegments()
	s := segments[random.IntN(len(segments))]
	switch f {
	case truncate:
		last := x.tiles[len(x.tiles)-1]
		last.Tiles = last.GetTiles()[:len(last.GetTiles())-1]
		return x, "the last tile is missing", nil
	case flipPacked:
		detail, err := flipPackedBit(tiles[random.IntN(len(tiles))], random)
		return x, detail, err
	case flipValue:
		detail, err := flipValueBit(tiles[random.IntN(len(tiles))], random)
		return x, detail, err
	case flipDigest:
		bit := random.IntN(64)
		s.Digest ^= 1 << bit
		return x, fmt.Sprintf("bit %d of the digest of segment %d", bit, s.GetSegment()), nil
	case flipSegment:
		bit := random.IntN(32)
		detail := fmt.Sprintf("bit %d of the number of segment %d", bit, s.GetSegment())
		s.Segment ^= 1 << bit
		return x, detail, nil
	case flipState:
		at, bit := random.IntN(len(s.GetState())), random.IntN(8)
		s.State[at] ^= 1 << bit
		return x, fmt.Sprintf("bit %d of byte %d of the state of segment %d", bit, at, s.GetSegment()), nil
	case flipSums:
		return x, flipSumBit(s, random), nil
	default:
		return x, "", fmt.Errorf("fault %q does no damage", f)
	}
}

// flipPackedBit flips a bit of a frame. Some bits of a frame mean nothing: one that does is taken.
func flipPackedBit(t *farmv1.Tile, random *rand.Rand) (string, error) {
	before, err := unpack(t.GetData())
	if err != nil {
		return "", err
	}
	for {
		at, bit := random.IntN(len(t.GetData())), random.IntN(8)
		t.Data[at] ^= 1 << bit
		after, err := unpack(t.GetData())
		if err != nil || !slices.Equal(before, after) {
			return fmt.Sprintf("bit %d of byte %d of a packed tile of plane %d", bit, at, t.GetPlane()), nil
		}
		t.Data[at] ^= 1 << bit
	}
}

// flipValueBit does what a flip in the film of the worker does, before it is sealed.
func flipValueBit(t *farmv1.Tile, random *rand.Rand) (string, error) {
	values, err := unpack(t.GetData())
	if err != nil {
		return "", err
	}
	at := random.IntN(len(values))
	for values[at] == 0 { // a tile that is sent has one that is not
		at = (at + 1) % len(values)
	}
	bit := random.IntN(64)
	values[at] ^= 1 << bit
	t.Data = pack(values)
	return fmt.Sprintf("bit %d of value %d of a tile of plane %d", bit, at, t.GetPlane()), nil
}

// flipSumBit flips a bit of what is added up over segments beside the film.
func flipSumBit(s *farmv1.SegmentResult, random *rand.Rand) string {
	sums, counts, bit := s.GetLargeStepSums(), s.GetCounts(), random.IntN(64)
	if len(sums) == 0 || random.IntN(2) == 0 {
		counts.Rays ^= 1 << bit
		return fmt.Sprintf("bit %d of the rays of segment %d", bit, s.GetSegment())
	}
	chain := random.IntN(len(sums))
	sums[chain].Sum = math.Float64frombits(math.Float64bits(sums[chain].GetSum()) ^ 1<<bit)
	return fmt.Sprintf("bit %d of the sum of chain %d of segment %d", bit, chain, s.GetSegment())
}

// damagedReport returns a report of which a bit flipped on the wire, and says where. Of such reports
// it is one that can be read, comes from the same worker and says something else.
func damagedReport(in *farmv1.ReportRequest, random *rand.Rand) (*farmv1.ReportRequest, string, error) {
	sent, err := proto.Marshal(in)
	if err != nil {
		return nil, "", fmt.Errorf("damage a report: %w", err)
	}
	for {
		at, bit := random.IntN(len(sent)), random.IntN(8)
		sent[at] ^= 1 << bit
		out := &farmv1.ReportRequest{}
		readable := proto.Unmarshal(sent, out) == nil
		sent[at] ^= 1 << bit
		if readable && out.GetWorkerId() == in.GetWorkerId() && !proto.Equal(in, out) {
			return out, fmt.Sprintf("bit %d of byte %d of %d", bit, at, len(sent)), nil
		}
	}
}

// forged returns the parcel with a wrong value in its film, whose digest and that of the segment fit, as
// does the segment's checksum: what a worker sends whose memory was wrong before it splatted.
func forged(x parcel, segment uint32) (parcel, error) {
	x = x.clone()
	for _, t := range x.all() {
		if t.GetLow() || t.GetY() != 0 {
			continue // pixels of the first row need no width to be numbered
		}
		values, err := unpack(t.GetData())
		if err != nil {
			return x, err
		}
		const added = 1 << 20
		values[0] += added // red, first row, first column of the tile
		t.Data = pack(values)
		change := added * pixelHash(32*uint64(t.GetX())) * planeHash(uint64(t.GetPlane()), 0)
		x.header.Batch.Digest += change
		for _, s := range x.header.GetBatch().GetSegments() {
			if s.GetSegment() == segment {
				s.Digest += change
				s.Checksum = checksum.Of(s)
			}
		}
		return x, nil
	}
	return x, errors.New("the film has no tile in its first row")
}

// The hashes of BatchHeader.digest.
func mix(x uint64) uint64 {
	z := (x + 1) * 0x9e3779b97f4a7c15
	z = (z ^ z>>30) * 0xbf58476d1ce4e5b9
	z = (z ^ z>>27) * 0x94d049bb133111eb
	return z ^ z>>31
}

func pixelHash(i uint64) uint64 { return mix(i) | 1 }

func planeHash(plane, channel uint64) uint64 { return mix(1<<48+3*plane+channel) | 1 }

// unpack reads the values of a tile, see Tile.data.
func unpack(data []byte) ([]int64, error) {
	decoder, err := zstd.NewReader(nil, zstd.WithDecoderConcurrency(1), zstd.WithDecoderMaxMemory(8<<20))
	if err != nil {
		return nil, fmt.Errorf("unpack a tile: %w", err)
	}
	defer decoder.Close()
	raw, err := decoder.DecodeAll(data, nil)
	if err != nil {
		return nil, fmt.Errorf("unpack a tile: %w", err)
	}
	n := len(raw) / 8
	values := make([]int64, n)
	for i := range values {
		var word [8]byte
		for k := range word {
			word[k] = raw[k*n+i]
		}
		values[i] = int64(binary.LittleEndian.Uint64(word[:]))
	}
	return values, nil
}

func pack(values []int64) []byte {
	n := len(values)
	raw := make([]byte, 8*n)
	for i, v := range values {
		for k := range 8 {
			raw[k*n+i] = byte(v >> (8 * k))
		}
	}
	encoder, err := zstd.NewWriter(nil, zstd.WithEncoderConcurrency(1))
	if err != nil {
		panic(err) // the options are right
	}
	defer encoder.Close()
	return encoder.EncodeAll(raw, nil)
}
