package main

import (
	"fmt"
	"math/rand/v2"
	"slices"
	"strconv"
	"strings"
	"sync"
)

// fault is one way to disturb a delivery or a report.
type fault string

// The faults. Those of reports are repeat, repeatLater, stale and flipReport.
const (
	none        fault = "none"
	repeat      fault = "repeat"       // twice, at once
	repeatLater fault = "repeat later" // once more, seconds later
	delay       fault = "delay"        // a second or more late
	reorder     fault = "reorder"      // after a later one
	stale       fault = "stale"        // after its leases ran out and others rendered it
	breakOff    fault = "break off"    // the stream ends in between; the worker repeats it
	truncate    fault = "truncate"     // the last tiles are missing
	flipPacked  fault = "flip packed"  // a bit of a packed tile
	flipDigest  fault = "flip digest"  // a bit of a segment's digest
	flipValue   fault = "flip value"   // a bit of a value of the film
	flipSegment fault = "flip segment" // a bit of a segment's number
	flipState   fault = "flip state"   // a bit of the state of a segment's chains
	flipSums    fault = "flip sums"    // a bit of a segment's counts or large-step sums
	flipReport  fault = "flip report"  // a bit of a report on the wire
)

var allFaults = []fault{
	repeat, repeatLater, delay, reorder, stale, breakOff,
	truncate, flipPacked, flipDigest, flipValue, flipSegment, flipState, flipSums, flipReport,
}

func faultNames() []string {
	names := make([]string, len(allFaults))
	for i, f := range allFaults {
		names[i] = strings.ReplaceAll(string(f), " ", "-")
	}
	return names
}

// damages tells whether the fault changes what a delivery says.
func (f fault) damages() bool {
	return slices.Contains([]fault{truncate, flipPacked, flipDigest, flipValue, flipSegment, flipState, flipSums}, f)
}

func (f fault) fitsReports() bool {
	return slices.Contains([]fault{repeat, repeatLater, stale, flipReport}, f)
}

func (f fault) fitsDeliveries() bool { return f != flipReport }

// schedule says what happens to the n-th message: a function of seed and n, as far as messages take
// what they are dealt.
type schedule struct {
	seed  uint64
	rate  float64
	kinds []fault

	mu                  sync.Mutex
	n, lastStale        int // number of the latest message, and of the latest that became stale
	deliveries, reports deck
}

// deck deals all faults of a call in random order before any comes again. One that a message cannot
// take stays in it for the next.
type deck struct {
	fits    func(fault) bool
	decks   uint64
	waiting []fault
}

const (
	// reportShare of the rate is that of reports: each holds its whole job up.
	reportShare = 0.5
	// stalePause is the number of messages from one that becomes stale to the next: it holds its job up
	// for half a minute.
	stalePause = 100
)

func newSchedule(seed uint64, rate float64, kinds string) (*schedule, error) {
	s := &schedule{seed: seed, rate: rate, deliveries: deck{fits: fault.fitsDeliveries}, reports: deck{fits: fault.fitsReports}}
	for name := range strings.SplitSeq(kinds, ",") {
		f := fault(strings.ReplaceAll(name, "-", " "))
		if !slices.Contains(allFaults, f) {
			return nil, fmt.Errorf("--faults: %q should be one of %s", name, strings.Join(faultNames(), ","))
		}
		s.kinds = append(s.kinds, f)
	}
	return s, nil
}

// delivery draws the fault of the next message, a delivery, with a source for its details. takes tells
// whether the message can have a fault; it has the first for which takes says so.
func (s *schedule) delivery(takes func(fault) bool) (number int, f fault, random *rand.Rand) {
	return s.next(&s.deliveries, s.rate, takes)
}

// report is delivery for reports.
func (s *schedule) report(takes func(fault) bool) (number int, f fault, random *rand.Rand) {
	return s.next(&s.reports, reportShare*s.rate, takes)
}

func (s *schedule) next(d *deck, rate float64, takes func(fault) bool) (number int, f fault, random *rand.Rand) {
	s.mu.Lock()
	defer s.mu.Unlock()
	s.n++
	random = rand.New(rand.NewPCG(s.seed, uint64(s.n)))
	if random.Float64() >= rate {
		return s.n, none, random
	}
	deal := func() (fault, bool) {
		return d.deal(func(f fault) bool { return (f != stale || s.mayAge()) && takes(f) })
	}
	f, dealt := deal()
	if !dealt {
		s.refill(d)
		f, _ = deal()
	}
	if f == stale {
		s.lastStale = s.n
	}
	return s.n, f, random
}

// mayAge requires: mu.
func (s *schedule) mayAge() bool { return s.lastStale == 0 || s.n-s.lastStale >= stalePause }

func (d *deck) deal(takes func(fault) bool) (f fault, dealt bool) {
	for i, f := range d.waiting {
		if takes(f) {
			d.waiting = slices.Delete(d.waiting, i, i+1)
			return f, true
		}
	}
	return none, false
}

// refill puts the faults that are not in a deck below those that are.
func (s *schedule) refill(d *deck) {
	var added []fault
	for _, f := range s.kinds {
		if d.fits(f) && !slices.Contains(d.waiting, f) {
			added = append(added, f)
		}
	}
	random := rand.New(rand.NewPCG(s.seed, ^d.decks))
	random.Shuffle(len(added), func(i, j int) { added[i], added[j] = added[j], added[i] })
	d.decks++
	d.waiting = append(d.waiting, added...)
}

// place of a segment: in any job.
type place struct{ round, segment uint32 }

// parseForgery reads ROUND/SEGMENT; nil for an empty text.
func parseForgery(text string) (*place, error) {
	if text == "" {
		return nil, nil
	}
	first, second, _ := strings.Cut(text, "/")
	number, err := strconv.ParseUint(first, 10, 32)
	segment, err2 := strconv.ParseUint(second, 10, 32)
	if err != nil || err2 != nil {
		return nil, fmt.Errorf("--forge %q: should be ROUND/SEGMENT", text)
	}
	return &place{uint32(number), uint32(segment)}, nil
}
