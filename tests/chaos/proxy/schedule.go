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
	return slices.Contains([]fault{none, repeat, repeatLater, stale, flipReport}, f)
}

func (f fault) fitsDeliveries() bool { return f != flipReport }

// schedule says what happens to the n-th message: a function of seed and n.
type schedule struct {
	seed  uint64
	rate  float64
	kinds []fault

	mu sync.Mutex
	n  int
}

func newSchedule(seed uint64, rate float64, kinds string) (*schedule, error) {
	s := &schedule{seed: seed, rate: rate}
	for name := range strings.SplitSeq(kinds, ",") {
		f := fault(strings.ReplaceAll(name, "-", " "))
		if !slices.Contains(allFaults, f) {
			return nil, fmt.Errorf("--faults: %q should be one of %s", name, strings.Join(faultNames(), ","))
		}
		s.kinds = append(s.kinds, f)
	}
	return s, nil
}

// next draws the fault of the next message, with a source for its details.
func (s *schedule) next() (number int, f fault, random *rand.Rand) {
	s.mu.Lock()
	s.n++
	number = s.n
	s.mu.Unlock()
	random = rand.New(rand.NewPCG(s.seed, uint64(number)))
	if random.Float64() >= s.rate {
		return number, none, random
	}
	return number, s.kinds[random.IntN(len(s.kinds))], random
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
