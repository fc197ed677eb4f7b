// Package render holds what a job has rendered: the film, counts and chain states of its complete
// rounds, and the same for the rounds that are open. It decides what each delivered batch means and
// folds rounds in order. It is pure; the caller serializes calls that change a State.
package render

import (
	"fmt"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

// Account is what segments add up to beside the film and the chains.
type Account struct {
	Counts tally.Counts
	// Mutations and LargeSteps of each statistics group (chains only).
	Mutations, LargeSteps [film.StatGroups]uint64
	// CPUSeconds is statistics only.
	CPUSeconds float64
}

func (a *Account) add(b Account) {
	a.Counts.Add(b.Counts)
	for g := range film.StatGroups {
		a.Mutations[g] += b.Mutations[g]
		a.LargeSteps[g] += b.LargeSteps[g]
	}
	a.CPUSeconds += b.CPUSeconds
}

// OpenRecord is what an open round holds beside its film.
type OpenRecord struct {
	Round   int
	Ledger  *round.Ledger
	Account Account
	States  [][]byte       // by group, after this round
	Sums    [][]tally.Sums // by group, one per chain, since the chains' start
}

// Open is a round that is not folded yet.
type Open struct {
	OpenRecord
	Film *film.Film
}

// Progress is what the complete rounds left beside their film.
type Progress struct {
	// Closed counts the complete rounds that all else stands for.
	Closed  int
	Account Account
	States  [][]byte       // by group; empty before the first round is closed
	Sums    [][]tally.Sums // by group
	// Bootstrap of each half, and where the chains start (chains only).
	Bootstrap [film.Halves]tally.Sums
	Seeds     [][]bootstrap.Seed
	// Lengths are the bootstrap's sums of each path length (mmlt).
	Lengths []tally.Sums
	// Previous is the ledger of the round closed last: late duplicates are still checked.
	Previous *round.Ledger
	// Points of the closed rounds.
	Points []job.ConvergencePoint
	// Cut is set while round Closed has a part in the film already. Remainders are the sizes of what
	// was left of such rounds, by round, once they are closed: late duplicates have them.
	Cut        *Cut
	Remainders map[int]uint64
}

// State of a job in its rendering phase.
type State struct {
	Spec  *jobv1.ResolvedSpec
	Cells int // film cells, border included
	Total *film.Film
	Progress
	Open     []*Open // in order: round Closed and perhaps Closed + 1
	expected []bool  // segments of a round
}

// New starts rendering. seeds are nil for independent samples; for chains a group without seeds belongs to
// a dark half and has no work.
func New(spec *jobv1.ResolvedSpec, cells int, boot [film.Halves]tally.Sums, seeds [][]bootstrap.Seed) *State {
	s := &State{
		Spec: spec, Cells: cells, Total: film.New(plan.Shape(spec)),
		Progress: Progress{Bootstrap: boot, Seeds: seeds},
	}
	s.prepare()
	s.States = make([][]byte, len(s.expected))
	s.Sums = make([][]tally.Sums, len(s.expected))
	s.OpenRound(0)
	return s
}

// Resume continues from what a checkpoint kept.
func Resume(spec *jobv1.ResolvedSpec, cells int, total *film.Film, p Progress, open []*Open) (*State, error) {
	s := &State{Spec: spec, Cells: cells, Total: total, Progress: p, Open: open}
	if s.Chains() && len(p.Seeds) != int(spec.GetChainGroups()) {
		return nil, fmt.Errorf("render: seeds of %d groups, not %d", len(p.Seeds), spec.GetChainGroups())
	}
	s.prepare()
	if total.Shape() != plan.Shape(spec) || len(p.States) != len(s.expected) || len(p.Points) != p.Closed {
		return nil, fmt.Errorf("render: progress does not fit its spec")
	}
	for _, o := range open {
		if len(o.Ledger.Expected) != len(s.expected) {
			return nil, fmt.Errorf("render: round %d has %d segments, not %d", o.Round, len(o.Ledger.Expected), len(s.expected))
		}
	}
	s.OpenRound(s.Closed)
	return s, nil
}

func (s *State) prepare() {
	s.expected = make([]bool, plan.Segments(s.Spec, s.Cells))
	for i := range s.expected {
		s.expected[i] = !s.Chains() || len(s.Seeds[i]) > 0
	}
}

// Chains tells whether the job runs Markov chains.
func (s *State) Chains() bool { return plan.RunsChains(s.Spec) }

// Expected tells which segments a round has.
func (s *State) Expected() []bool { return s.expected }

// OpenRound returns an open round, opening it if it is the next in line; nil for rounds further
// ahead and for closed ones.
func (s *State) OpenRound(number int) *Open {
	at := number - s.Closed
	if at < 0 || at > 1 || at > len(s.Open) || number >= len(s.Spec.GetRoundSizes()) {
		return nil
	}
	if at == len(s.Open) {
		record := OpenRecord{
			Round:  number,
			Ledger: round.NewLedger(s.expected),
			States: make([][]byte, len(s.expected)),
			Sums:   make([][]tally.Sums, len(s.expected)),
		}
		s.Open = append(s.Open, &Open{OpenRecord: record, Film: film.New(plan.Shape(s.Spec))})
	}
	return s.Open[at]
}

// StateBefore returns the chain state of a group at the start of a round; false if the group has
// not come that far.
func (s *State) StateBefore(number, group int) ([]byte, bool) {
	switch {
	case number == s.Closed:
		return s.States[group], true
	case number == s.Closed+1 && len(s.Open) > 0 && s.Open[0].Ledger.Counted[group]:
		return s.Open[0].States[group], true
	}
	return nil, false
}

// Ready tells whether a segment of a round can be rendered now.
func (s *State) Ready(number, segment int) bool {
	if !s.expected[segment] || number < s.Closed || number > s.Closed+1 || number >= len(s.Spec.GetRoundSizes()) {
		return false
	}
	if at := number - s.Closed; at < len(s.Open) && s.Open[at].Ledger.Counted[segment] {
		return false
	}
	if !s.Chains() {
		return true
	}
	_, ok := s.StateBefore(number, segment)
	return ok
}

// SamplesBefore is the sum of the sizes of all rounds before this one, which is not closed, and of
// what was rendered of this one before it was cut.
func (s *State) SamplesBefore(number int) uint64 {
	sum := sumOf(s.Spec.GetRoundSizes()[:number])
	if s.Cut != nil && number == s.Closed {
		sum += s.Cut.Size
	}
	return sum
}

// DirectBefore is the number of samples per cell of direct light apart, likewise.
func (s *State) DirectBefore(number int) uint64 {
	if !plan.DirectApart(s.Spec) {
		return 0
	}
	sum := sumOf(s.Spec.GetDirectSizes()[:number])
	if s.Cut != nil && number == s.Closed {
		sum += s.Cut.Direct
	}
	return sum
}

func sumOf(sizes []uint64) uint64 {
	var sum uint64
	for _, n := range sizes {
		sum += n
	}
	return sum
}

// Judge says what a batch means. It fails for batches that no round could have produced.
func (s *State) Judge(b *merge.Batch) (round.Verdict, error) {
	for _, e := range b.Segments {
		if err := s.checkCounts(b.Round, e); err != nil {
			return 0, err
		}
	}
	if b.Round == s.Closed-1 && s.Previous != nil {
		return s.Previous.Judge(b.Entries())
	}
	if b.Round < s.Closed {
		return round.Duplicate, nil
	}
	open := s.OpenRound(b.Round)
	if open == nil {
		return round.Superseded, nil
	}
	return open.Ledger.Judge(b.Entries())
}

// Counted returns what a segment was counted with; false if it was not, or too long ago to tell.
func (s *State) Counted(number, segment int) (round.Mark, bool) {
	var ledger *round.Ledger
	switch at := number - s.Closed; {
	case at == -1:
		ledger = s.Previous
	case at >= 0 && at < len(s.Open):
		ledger = s.Open[at].Ledger
	}
	if ledger == nil || segment < 0 || segment >= len(ledger.Counted) || !ledger.Counted[segment] {
		return round.Mark{}, false
	}
	return ledger.Marks[segment], true
}

// Unwind forgets what was delivered to an open round and to those after it.
func (s *State) Unwind(number int) {
	if at := number - s.Closed; at >= 0 && at < len(s.Open) {
		s.Open = s.Open[:at]
	}
	s.OpenRound(s.Closed)
}

// checkCounts compares what a segment claims to have done with what its round asks for: the
// development divides by these numbers.
func (s *State) checkCounts(number int, e merge.Segment) error {
	if number < 0 || number >= len(s.Spec.GetRoundSizes()) || e.Segment < 0 || e.Segment >= len(s.expected) {
		return fmt.Errorf("no segment %d in round %d", e.Segment, number)
	}
	want := s.segmentSize(number)
	if s.Chains() {
		want *= uint64(s.Spec.GetGroupSize())
		if e.Counts.LargeSteps+e.Counts.SmallSteps+e.Counts.SubpathSteps != e.Counts.Mutations {
			return fmt.Errorf("segment %d: %d large, %d small and %d subpath steps do not make %d mutations",
				e.Segment, e.Counts.LargeSteps, e.Counts.SmallSteps, e.Counts.SubpathSteps, e.Counts.Mutations)
		}
	} else {
		perSegment := plan.CellsPerSegment(s.Spec)
		want *= uint64(min(perSegment, s.Cells-e.Segment*perSegment))
	}
	if e.Counts.Mutations != want {
		return fmt.Errorf("segment %d of round %d has %d mutations or samples, not %d", e.Segment, number, e.Counts.Mutations, want)
	}
	return nil
}

// Commit merges a batch. Requires: Judge said round.Fresh.
func (s *State) Commit(b *merge.Batch) {
	open := s.OpenRound(b.Round)
	for _, t := range b.Tiles {
		open.Film.Add(t)
	}
	for _, e := range b.Segments {
		account := Account{Counts: e.Counts}
		if s.Chains() {
			g := e.Segment % film.StatGroups
			account.Mutations[g], account.LargeSteps[g] = e.Counts.Mutations, e.Counts.LargeSteps
		}
		open.Account.add(account)
		open.States[e.Segment] = e.State
		open.Sums[e.Segment] = e.Sums
	}
	open.Account.CPUSeconds += b.CPUSeconds
	open.Ledger.Count(b.Entries())
}

// Complete tells whether the first open round has everything.
func (s *State) Complete() bool { return len(s.Open) > 0 && s.Open[0].Ledger.Complete() }
