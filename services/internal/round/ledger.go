// Package round keeps the account of rounds: which segments were counted with which digests, what
// that says about a batch, and whether a complete round is the last. It is pure.
package round

import "fmt"

// Mark identifies what a segment contributed.
type Mark struct {
	// Digest of its splats, see BatchHeader.digest.
	Digest uint64
	// Evidence is a hash of everything else that it reported: counts, states and sums.
	Evidence [16]byte
}

// Entry is one segment as a batch reports it.
type Entry struct {
	Segment int
	Mark    Mark
}

// Ledger is the set of counted segments of one round.
type Ledger struct {
	// Expected marks the segments that the round has; a dark half's have no work.
	Expected []bool
	// Counted and Marks are by segment.
	Counted []bool
	Marks   []Mark
	// Missing is the number of expected segments that are not counted.
	Missing int
}

// NewLedger returns the ledger of a round that expects these segments.
func NewLedger(expected []bool) *Ledger {
	l := &Ledger{
		Expected: expected,
		Counted:  make([]bool, len(expected)),
		Marks:    make([]Mark, len(expected)),
	}
	for _, e := range expected {
		if e {
			l.Missing++
		}
	}
	return l
}

// Verdict on a batch.
type Verdict int

// The verdicts, see Outcome in farm_service.proto.
const (
	Fresh      Verdict = iota // nothing of it is counted: merge it
	Duplicate                 // everything is counted, with the same marks
	Superseded                // part of it is counted
	Conflict                  // a counted segment has another mark
)

// Judge says what to do with a batch. It fails for segments that the round does not have or that
// the batch lists twice.
func (l *Ledger) Judge(batch []Entry) (Verdict, error) {
	seen := make(map[int]bool, len(batch))
	counted, conflict := 0, false
	for _, e := range batch {
		if e.Segment < 0 || e.Segment >= len(l.Expected) || !l.Expected[e.Segment] {
			return 0, fmt.Errorf("round has no segment %d", e.Segment)
		}
		if seen[e.Segment] {
			return 0, fmt.Errorf("segment %d is listed twice", e.Segment)
		}
		seen[e.Segment] = true
		if l.Counted[e.Segment] {
			counted++
			conflict = conflict || l.Marks[e.Segment] != e.Mark
		}
	}
	switch {
	case len(batch) == 0:
		return 0, fmt.Errorf("batch has no segments")
	case conflict:
		return Conflict, nil
	case counted == 0:
		return Fresh, nil
	case counted == len(batch):
		return Duplicate, nil
	}
	return Superseded, nil
}

// Count marks a batch's segments as counted. Requires: Judge said Fresh.
func (l *Ledger) Count(batch []Entry) {
	for _, e := range batch {
		l.Counted[e.Segment] = true
		l.Marks[e.Segment] = e.Mark
		l.Missing--
	}
}

// Complete tells whether every expected segment is counted.
func (l *Ledger) Complete() bool { return l.Missing == 0 }

// Clone returns a copy that later counts do not change.
func (l *Ledger) Clone() *Ledger {
	c := *l
	c.Counted = append([]bool(nil), l.Counted...)
	c.Marks = append([]Mark(nil), l.Marks...)
	return &c
}
