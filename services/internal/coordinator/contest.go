package coordinator

import (
	"fmt"
	"log/slog"
	"slices"
	"strings"

	"metrofarm/services/internal/check"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/round"
)

// A segment may be delivered after it was counted: by a worker whose lease had run out, or that rendered a
// copy of a straggler. If the two differ, one of them is wrong, and it may be the one in the film.
//
// While the round is open it is not closed before that is decided, as for a batch that is held (check.go):
// both workers are flagged, nothing more is merged of either, a third renders the segment, and whom it
// contradicts is excluded. If that is the first one, or nobody decides and the job is paused, what was
// counted of the round and those after it is thrown away and rendered again: a film cannot be taken out of
// a sum. Tasks get new names then, so that nothing that was rendered from the wrong states is taken.
//
// Who delivered a segment is known only to the coordinator that counted it. In a round that was counted
// before this one had the job the first worker cannot be kept from confirming itself, so nobody is asked: the
// round is thrown away at once, its segment is rendered twice this time, and so is all that the second
// worker delivers.
//
// A round that is closed cannot be rendered again: its chains have moved on. Then both workers are flagged
// and the job has a warning.

// unknown is the worker that delivered a segment before this coordinator had the job.
const unknown = ""

// countedBy tells on whose word a segment was counted, and whether on that alone.
type countedBy struct {
	worker    string
	unchecked bool
}

// lateWarning begins the warning of a segment whose round was closed already.
const lateWarning = "workers disagree about a segment of a round that is closed"

// compare compares a segment with what it was counted as, if it was. It returns what is wrong, nothing if
// nothing is. Requires: mu.
func (r *run) compare(key segmentKey, worker string, mark round.Mark) (complaint string) {
	counted, known := r.state.Counted(key.round, key.segment)
	if !known || counted == mark {
		return ""
	}
	if key.round < r.state.Closed {
		return r.warnOfLate(key, worker, counted, mark)
	}
	first := r.checks.by[key].worker
	if first == unknown {
		return r.beginAgain(key, worker, counted, mark)
	}
	h := &heldBatch{
		worker: first, counted: true, since: r.c.options.Now(),
		batch: &merge.Batch{
			Job: r.id, Round: key.round, Segments: []merge.Segment{{Entry: round.Entry{Segment: key.segment, Mark: counted}}},
		},
		cases: make(map[segmentKey]*check.Case),
	}
	r.checks.held = append(r.checks.held, h)
	r.checks.of[key] = h
	r.contest(key.round)
	r.openCase(h, key)
	complaint = r.testify(h, key, worker, mark)
	r.save() // before anything that follows from it: a restart must not keep what is disputed
	return complaint
}

// beginAgain throws the round of a segment away of which nobody knows any more who delivered it first.
// Requires: mu; the round is open.
func (r *run) beginAgain(key segmentKey, worker string, counted, mark round.Mark) (complaint string) {
	c := &check.Case{Heard: []check.Testimony{{Worker: unknown, Mark: counted}, {Worker: worker, Mark: mark}}}
	r.checks.doubted[worker] = true
	r.checks.twice[key] = true
	r.unwind(key.round)
	return r.evidence(key, c) + "; its round is rendered again"
}

// warnOfLate requires: mu; the segment's round is closed.
func (r *run) warnOfLate(key segmentKey, worker string, counted, mark round.Mark) (complaint string) {
	first := r.checks.by[key].worker
	r.c.flag(first)
	c := &check.Case{Heard: []check.Testimony{{Worker: first, Mark: counted}, {Worker: worker, Mark: mark}}}
	complaint = r.evidence(key, c) + "; the first is in the image"
	if !slices.ContainsFunc(r.rec.Warnings, func(text string) bool { return strings.HasPrefix(text, lateWarning) }) {
		r.warn(fmt.Sprintf("%s: %s; to be sure, repeat the job from its resolved spec", lateWarning, complaint))
	}
	return complaint
}

// contested tells whether workers disagree about a segment of an open round that was counted. Requires: mu.
func (r *run) contested() bool {
	return slices.ContainsFunc(r.checks.held, func(h *heldBatch) bool { return h.counted })
}

// contest notes that the film of an open round may be wrong. Requires: mu; the caller saves.
func (r *run) contest(number int) {
	if r.rec.Contested == nil || *r.rec.Contested > number {
		r.rec.Contested = &number
	}
}

// uphold notes that what was counted is right, or stays. Requires: mu.
func (r *run) uphold() {
	if !r.contested() {
		// A checkpoint from before rounds were thrown away may still be the last one.
		r.dirty = true
		r.save()
	}
	r.c.wake()
}

// unwind throws the open round of a segment that is wrong, or may be, away with those after it; they are
// rendered again. Nobody decides about other contested segments then: the earliest round that has one goes
// too. Requires: mu.
func (r *run) unwind(number int) {
	for _, other := range r.checks.held {
		if other.counted {
			number = min(number, other.batch.Round)
		}
	}
	r.discardFrom(number)
	r.clearTasks()
	r.openTasks()
	r.publish("fault", fmt.Sprintf("round %d is rendered again: it may hold a wrong segment", number), nil, slog.Int("round", number))
	r.save()
	r.c.announce()
}

// discardFrom throws an open round and those after it away. Requires: mu; the caller opens tasks and saves.
func (r *run) discardFrom(number int) {
	r.rec.Unwound++
	r.contest(number)
	r.uncount(number)
}

// uncount takes back what was counted of an open round and of those after it. Rounds that are closed stay:
// the contest that a record tells of may be older than they are. Requires: mu.
func (r *run) uncount(number int) {
	number = max(number, r.state.Closed)
	r.state.Unwind(number)
	r.uncounted++
	for key, by := range r.checks.by {
		if key.round < number {
			continue
		}
		if by.unchecked {
			r.checks.unchecked[by.worker]--
		}
		delete(r.checks.by, key)
	}
	r.dirty = true
}

// discardContested throws away what nobody will decide about: the job ends. Requires: mu; the caller saves.
func (r *run) discardContested() {
	if r.rec.State == job.Rendering && r.contested() && r.rec.Contested != nil {
		r.discardFrom(*r.rec.Contested)
	}
}
