package coordinator

import (
	"slices"
	"time"

	"metrofarm/services/internal/check"
	"metrofarm/services/internal/flow"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/round"
)

// segmentKey names a segment of a job.
type segmentKey struct{ round, segment int }

// heldBatch is not merged before the cases of its segments are decided. It lives in memory only:
// after a restart its segments are rendered again, to the same bits.
type heldBatch struct {
	worker string
	// counted: it stands for a segment that was merged before somebody contradicted it (contest.go).
	counted bool
	batch   *merge.Batch // packed
	bytes   int
	since   time.Time // of the hold, or of the latest dispute
	cases   map[segmentKey]*check.Case
}

func (h *heldBatch) mark(key segmentKey) round.Mark {
	at := slices.IndexFunc(h.batch.Segments, func(s merge.Segment) bool { return s.Segment == key.segment })
	return h.batch.Segments[at].Mark
}

func (h *heldBatch) disputed() bool {
	for _, c := range h.cases {
		if c.Ruling().Status == check.Disputed {
			return true
		}
	}
	return false
}

// checks is what a job knows of segments that are rendered twice. Guarded by run.mu.
type checks struct {
	held   []*heldBatch // in order of arrival
	of     map[segmentKey]*heldBatch
	proven map[segmentKey]round.Mark // two workers rendered this; of rounds that are not closed
	// suspects disagreed when the job was paused for it; nothing of them is taken until it goes on.
	suspects map[string]bool
	// by tells of the segments of open rounds, and of the one closed last, on whose word they were counted.
	by map[segmentKey]countedBy
	// doubted disagreed, and nobody decided: all that they deliver is checked, until a batch is confirmed.
	doubted map[string]bool
	// twice names segments that workers disagreed about without a decision: they are checked when they are
	// rendered again.
	twice map[segmentKey]bool
	// unchecked counts segments by the worker on whose word alone they were counted.
	unchecked map[string]int
}

func newChecks() checks {
	return checks{
		of: make(map[segmentKey]*heldBatch), proven: make(map[segmentKey]round.Mark),
		suspects: make(map[string]bool), unchecked: make(map[string]int),
		by: make(map[segmentKey]countedBy), doubted: make(map[string]bool),
		twice: make(map[segmentKey]bool),
	}
}

// clear forgets all held batches: nobody wants them any more.
func (k *checks) clear(queue *flow.Queue) {
	for _, h := range k.held {
		queue.Unhold(int64(h.bytes))
	}
	k.held = nil
	clear(k.of)
	clear(k.proven)
}

func (k *checks) overlaps(batch *merge.Batch) bool {
	return slices.ContainsFunc(batch.Segments, func(s merge.Segment) bool {
		return k.of[segmentKey{batch.Round, s.Segment}] != nil
	})
}

// disputes tells whether a worker is party to a dispute.
func (k *checks) disputes(worker string) bool {
	for _, h := range k.held {
		for _, c := range h.cases {
			if c.Knows(worker) && c.Ruling().Status == check.Disputed {
				return true
			}
		}
	}
	return false
}

func (r *run) checkTask(key segmentKey) string {
	return r.segmentTask(key.round, key.segment) + "/check"
}

// toCheck lists the segments of a fresh batch that another worker must confirm: the selected ones,
// if there is another worker. Requires: mu.
func (r *run) toCheck(w worker, batch *merge.Batch) []segmentKey {
	var selected []segmentKey
	for _, s := range batch.Segments {
		key := segmentKey{batch.Round, s.Segment}
		_, proven := r.checks.proven[key]
		suspicious := r.checks.doubted[w.id] || r.checks.twice[key]
		if !proven && (suspicious || check.Selected(r.c.options.CheckOneIn, r.spec.GetSeed(), key.round, key.segment)) {
			selected = append(selected, key)
		}
	}
	others := slices.DeleteFunc(r.c.renderers(r.spec.GetWorkerVersion()), func(id string) bool { return id == w.id })
	if len(others) == 0 {
		return nil
	}
	return selected
}

// hold keeps a batch and asks other workers for the selected segments. False: there is no room; its
// segments must be rendered again.
// Requires: mu.
func (r *run) hold(w worker, batch *merge.Batch, selected []segmentKey) bool {
	h := &heldBatch{
		worker: w.id, batch: batch, bytes: batch.Pack(), since: r.c.options.Now(),
		cases: make(map[segmentKey]*check.Case),
	}
	if !r.c.merging.Hold(int64(h.bytes)) {
		return false
	}
	r.checks.held = append(r.checks.held, h)
	for _, s := range batch.Segments {
		r.checks.of[segmentKey{batch.Round, s.Segment}] = h
		r.closeTask(r.segmentTask(batch.Round, s.Segment))
	}
	for _, key := range selected {
		r.openCase(h, key)
	}
	return true
}

// openCase asks another worker for a segment of a held batch. Requires: mu.
func (r *run) openCase(h *heldBatch, key segmentKey) *check.Case {
	c := &check.Case{}
	c.Hear(h.worker, h.mark(key))
	h.cases[key] = c
	id := r.checkTask(key)
	r.tasks[id] = taskKey{phase: job.Rendering, round: key.round, segment: key.segment}
	r.table.PutApart(id, r.segmentOrder(key.round, key.segment))
	r.table.Bar(id, h.worker)
	return c
}

// closeCase requires: mu.
func (r *run) closeCase(h *heldBatch, key segmentKey) {
	delete(h.cases, key)
	r.closeTask(r.checkTask(key))
}

// settle merges a held batch whose cases are all closed, unless it was thrown away meanwhile, with its
// round. Requires: mu.
func (r *run) settle(h *heldBatch) {
	if len(h.cases) > 0 || !slices.Contains(r.checks.held, h) {
		return
	}
	r.unhold(h)
	if h.counted {
		r.uphold()
		return
	}
	verdict, err := r.state.Judge(h.batch)
	if err == nil && verdict == round.Fresh {
		err = h.batch.Unpack(r.c.codec, plan.Shape(r.spec))
	}
	if err != nil || verdict != round.Fresh || h.batch.Round > r.lastRound() {
		r.reopen(h)
		return
	}
	r.count(h.batch, h.worker)
}

// drop gives a held batch up; its segments are leased again. Requires: mu.
func (r *run) drop(h *heldBatch) {
	switch {
	case !slices.Contains(r.checks.held, h): // gone with another one
	case h.counted:
		r.unwind(h.batch.Round)
	default:
		r.forget(h)
		r.reopen(h)
	}
}

// forget gives a held batch up that is not wanted any more. Requires: mu.
func (r *run) forget(h *heldBatch) {
	for key := range h.cases {
		r.closeCase(h, key)
	}
	r.unhold(h)
}

func (r *run) unhold(h *heldBatch) {
	r.c.merging.Unhold(int64(h.bytes))
	r.checks.held = slices.DeleteFunc(r.checks.held, func(o *heldBatch) bool { return o == h })
	for _, s := range h.batch.Segments {
		delete(r.checks.of, segmentKey{h.batch.Round, s.Segment})
	}
}

func (r *run) reopen(h *heldBatch) {
	for _, s := range h.batch.Segments {
		r.openSegment(h.batch.Round, s.Segment)
	}
}

// count merges a batch. Requires: mu; nothing of it was counted and its round is wanted.
func (r *run) count(batch *merge.Batch, workerID string) {
	r.state.Commit(batch)
	var mutations uint64
	for _, s := range batch.Segments {
		mutations += s.Counts.Mutations
		key := segmentKey{batch.Round, s.Segment}
		_, proven := r.checks.proven[key]
		if !proven {
			r.checks.unchecked[workerID]++
		}
		r.checks.by[key] = countedBy{workerID, !proven}
		// Close by segment, not by the reported lease: whoever holds the task, it is done.
		r.closeTask(r.segmentTask(batch.Round, s.Segment))
		if batch.Round == r.state.Closed {
			r.openSegment(batch.Round+1, s.Segment)
		}
	}
	r.reportAnomalies(batch.Anomalies)
	r.dirty = true
	now := r.c.options.Now()
	r.meter.add(mutations, now)
	r.c.credit(workerID, mutations)
	r.charge(batch.CPUSeconds, len(batch.Segments))
	r.c.metrics.countMerged(batch)
	if r.state.Complete() {
		r.c.wake()
	}
}
