// Package merge takes a delivery apart: it checks every message against the film's shape, decodes
// the tiles and proves that header, segments and film agree. It is pure; memory is bounded by the
// film's shape.
package merge

import (
	"crypto/sha256"
	"encoding/binary"
	"errors"
	"fmt"
	"math"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

// What can be wrong with a batch. Each error is one of these.
var (
	// ErrMalformed: the header says what no correct worker says; the outcome is REJECTED. It speaks
	// against the task, which makes workers say so.
	ErrMalformed = errors.New("malformed batch")
	// ErrDamaged: the tiles are not those that were packed: some are missing, there are too many, or they
	// do not unpack; the outcome is REJECTED. It speaks against the worker or its connection only.
	ErrDamaged = errors.New("damaged batch")
	// ErrDigest: film and digests disagree; the outcome is CONFLICT. It speaks against the worker or its
	// connection only.
	ErrDigest = errors.New("digests disagree")
)

// Limits on one batch.
const (
	maxStateBytes = 16 << 20 // of one chain group
	maxAnomalies  = 16
)

// UnpackedBytes is the memory of so many tiles, decoded.
func UnpackedBytes(tiles int) int64 { return int64(tiles) * 8 * film.FullTileValues }

// Segment is one finished segment, checked.
type Segment struct {
	round.Entry
	Task   string
	Epoch  uint64
	Counts tally.Counts
	State  []byte
	Sums   []tally.Sums // per chain of the group, in units of the film unit
}

// Batch is a sealed film with what was rendered into it.
type Batch struct {
	Job        string
	Round      int
	Segments   []Segment
	Tiles      []film.Tile
	CPUSeconds float64 // as the worker reports it: may be anything
	Anomalies  []*farmv1.Anomaly

	packed []*farmv1.Tile // the same tiles as they came
}

// Pack forgets the decoded tiles and returns about how many bytes the batch takes without them: a
// dense film of 1920 x 1080 takes 200 MiB decoded, 4 to 17 MiB packed.
func (b *Batch) Pack() (bytes int) {
	b.Tiles = nil
	for _, t := range b.packed {
		bytes += len(t.GetData())
	}
	for _, s := range b.Segments {
		bytes += len(s.State)
	}
	return bytes
}

// Unpack decodes the tiles of a packed batch again.
func (b *Batch) Unpack(codec *film.Codec, shape film.Shape) error {
	tiles := make([]film.Tile, 0, len(b.packed))
	for _, t := range b.packed {
		tile, _, err := codec.DecodeTile(shape, t)
		if err != nil {
			return fmt.Errorf("merge: unpack: %w", err)
		}
		tiles = append(tiles, tile)
	}
	b.Tiles = tiles
	return nil
}

// Entries lists the segments for a ledger.
func (b *Batch) Entries() []round.Entry {
	entries := make([]round.Entry, len(b.Segments))
	for i, s := range b.Segments {
		entries[i] = s.Entry
	}
	return entries
}

// Assembler builds one batch from its messages.
type Assembler struct {
	codec  *film.Codec
	shape  film.Shape
	header *farmv1.BatchHeader
	batch  *Batch
	seen   map[int]bool
	digest uint64
}

// NewAssembler checks the header. chainsPerGroup is 0 for independent samples.
func NewAssembler(codec *film.Codec, shape film.Shape, chainsPerGroup int, h *farmv1.BatchHeader) (*Assembler, error) {
	if int64(h.GetTileCount()) > int64(shape.TileCount()) {
		return nil, fmt.Errorf("%w: %d tiles in a film of %d", ErrMalformed, h.GetTileCount(), shape.TileCount())
	}
	if len(h.GetAnomalies()) > maxAnomalies {
		return nil, fmt.Errorf("%w: %d anomalies, at most %d", ErrMalformed, len(h.GetAnomalies()), maxAnomalies)
	}
	batch := &Batch{
		Job: h.GetJobId(), Round: int(h.GetRound()),
		CPUSeconds: h.GetCpuSeconds(), Anomalies: h.GetAnomalies(),
	}
	for _, s := range h.GetSegments() {
		segment, err := checkSegment(s, chainsPerGroup)
		if err != nil {
			return nil, fmt.Errorf("%w: segment %d: %w", ErrMalformed, s.GetSegment(), err)
		}
		batch.Segments = append(batch.Segments, segment)
	}
	if len(batch.Segments) == 0 {
		return nil, fmt.Errorf("%w: no segments", ErrMalformed)
	}
	return &Assembler{codec: codec, shape: shape, header: h, batch: batch, seen: map[int]bool{}}, nil
}

// Add takes the next tiles.
func (a *Assembler) Add(tiles []*farmv1.Tile) error {
	for _, t := range tiles {
		if len(a.batch.Tiles) == int(a.header.GetTileCount()) {
			return fmt.Errorf("%w: more tiles than the %d announced", ErrDamaged, a.header.GetTileCount())
		}
		tile, digest, err := a.codec.DecodeTile(a.shape, t)
		if err != nil {
			return fmt.Errorf("%w: %w", ErrDamaged, err)
		}
		if a.seen[tile.Index] {
			return fmt.Errorf("%w: tile %d comes twice", ErrDamaged, tile.Index)
		}
		a.seen[tile.Index] = true
		a.digest += digest
		a.batch.Tiles = append(a.batch.Tiles, tile)
		a.batch.packed = append(a.batch.packed, t)
	}
	return nil
}

// Finish returns the batch once all its messages are in.
func (a *Assembler) Finish() (*Batch, error) {
	if len(a.batch.Tiles) != int(a.header.GetTileCount()) {
		return nil, fmt.Errorf("%w: %d tiles, %d announced", ErrDamaged, len(a.batch.Tiles), a.header.GetTileCount())
	}
	var segments uint64
	for _, s := range a.batch.Segments {
		segments += s.Mark.Digest
	}
	if a.digest != a.header.GetDigest() || segments != a.header.GetDigest() {
		return nil, fmt.Errorf("%w: film %016x, header %016x, segments %016x",
			ErrDigest, a.digest, a.header.GetDigest(), segments)
	}
	return a.batch, nil
}

func checkSegment(s *farmv1.SegmentResult, chains int) (Segment, error) {
	switch {
	case len(s.GetCounts().GetAnomalies()) > tally.AnomalyKinds:
		return Segment{}, fmt.Errorf("%d kinds of anomalies", len(s.GetCounts().GetAnomalies()))
	case max(len(s.GetCounts().GetProposedByLength()), len(s.GetCounts().GetAcceptedByLength())) > tally.MaxLengths:
		return Segment{}, errors.New("counts of too many path lengths")
	case max(len(s.GetCounts().GetProposedByTechnique()), len(s.GetCounts().GetAcceptedByTechnique())) > tally.MaxTechniques:
		return Segment{}, errors.New("counts of too many techniques")
	case len(s.GetState()) > maxStateBytes:
		return Segment{}, fmt.Errorf("state of %d bytes", len(s.GetState()))
	case chains > 0 && len(s.GetState()) == 0:
		return Segment{}, errors.New("no chain state")
	case len(s.GetLargeStepSums()) != chains:
		return Segment{}, fmt.Errorf("%d large-step sums for %d chains", len(s.GetLargeStepSums()), chains)
	}
	segment := Segment{
		Entry: round.Entry{
			Segment: int(s.GetSegment()),
			Mark:    round.Mark{Digest: s.GetDigest()},
		},
		Task: s.GetLease().GetTaskId(), Epoch: s.GetLease().GetEpoch(),
		Counts: tally.FromProto(s.GetCounts()), State: s.GetState(),
	}
	for _, p := range s.GetLargeStepSums() {
		sums := tally.Sums{Count: p.GetCount(), Sum: p.GetSum(), SumSquares: p.GetSumSquares()}
		if !finite(sums.Sum) || !finite(sums.SumSquares) || sums.Sum < 0 || sums.SumSquares < 0 {
			return Segment{}, errors.New("a large-step sum is not finite and non-negative")
		}
		segment.Sums = append(segment.Sums, sums)
	}
	segment.Mark.Evidence = evidence(&segment)
	return segment, nil
}

// evidence hashes what equal work must report equally beside splats.
func evidence(s *Segment) [16]byte {
	h := sha256.New()
	var buffer []byte
	for _, w := range s.Counts.Words() {
		buffer = binary.LittleEndian.AppendUint64(buffer, w)
	}
	for _, c := range s.Sums {
		buffer = binary.LittleEndian.AppendUint64(buffer, c.Count)
		buffer = binary.LittleEndian.AppendUint64(buffer, math.Float64bits(c.Sum))
		buffer = binary.LittleEndian.AppendUint64(buffer, math.Float64bits(c.SumSquares))
	}
	h.Write(buffer)
	h.Write(s.State)
	return [16]byte(h.Sum(nil))
}

func finite(v float64) bool { return !math.IsNaN(v) && !math.IsInf(v, 0) }
