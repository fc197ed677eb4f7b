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

// Where two workers exist, one segment in check.OneIn is rendered twice, which tells apart a worker
// whose film is wrong although its digests fit the film (bad memory, a mixed build).
//
// The batch of the first worker is held, and the segment is leased to another one as a check, which
// arrives in a batch of its own: check tasks are never leased together with others. What the second
// worker delivers is compared, not merged. If both agree, the held batch is merged. If not, both
// workers are flagged, nothing of either is merged, they are asked for checks of other segments
// only, and a third renders the segment; whom it contradicts is excluded: its held batches are
// dropped and it gets no more leases. If no third
// worker decides within CheckPatience, or it contradicts both, the job is paused with the evidence
// and all held batches are dropped; when it is resumed their segments are rendered again and checked
// again, by the workers there are then.
//
// A held batch whose check nobody can render any more, or nobody has rendered within CheckPatience,
// is merged unchecked: a round never waits for a worker that does not come.
//
// What an excluded worker had delivered before is in the film and cannot be told from the rest, the
// segments of complete rounds not even by round. The job and the worker say how many of its segments
// were counted on its word alone since the coordinator started; to be sure of the image, repeat the
// job from its resolved spec. The exclusion ends with the worker's process or the coordinator's.

// distrusts tells whether nothing is taken from, or leased to, a worker. Requires: mu.
func (r *run) distrusts(worker string) bool {
	return r.checks.suspects[worker] || r.c.isExcluded(worker)
}

// hear compares a batch with what other workers rendered its segments to, and acts on it. It
// returns what is wrong with the batch, nothing if nothing is. Requires: mu.
func (r *run) hear(w worker, batch *merge.Batch) (complaint string) {
	for _, s := range batch.Segments {
		key := segmentKey{batch.Round, s.Segment}
		if mark, known := r.checks.proven[key]; known && mark != s.Mark {
			return fmt.Sprintf("segment %d differs from what two other workers rendered", s.Segment)
		}
		if h := r.checks.of[key]; h != nil {
			complaint = r.testify(h, key, w.id, s.Mark)
		} else {
			complaint = r.compare(key, w.id, s.Mark)
		}
		if complaint != "" {
			return complaint
		}
	}
	return ""
}

// testify compares a segment with the one in a held batch. Requires: mu.
func (r *run) testify(h *heldBatch, key segmentKey, worker string, mark round.Mark) (complaint string) {
	same := h.mark(key) == mark
	if worker == h.worker {
		if same {
			return ""
		}
		if !h.counted { // else another worker must say which is right
			r.drop(h)
		}
		return fmt.Sprintf("the worker rendered segment %d differently before", key.segment)
	}
	c := h.cases[key]
	if c == nil && same {
		return "" // not selected, and nothing speaks against it
	}
	if c == nil {
		c = r.openCase(h, key) // seen twice by chance
	}
	c.Hear(worker, mark)
	r.table.Bar(r.checkTask(key), worker)
	return r.rule(h, key, c)
}

// rule acts on what a case has come to. Requires: mu.
func (r *run) rule(h *heldBatch, key segmentKey, c *check.Case) (complaint string) {
	switch ruling := c.Ruling(); ruling.Status {
	case check.Agreed:
		r.checks.proven[key] = ruling.Mark
		r.closeCase(h, key)
		if h.counted && ruling.Mark != h.mark(key) {
			r.unwind(h.batch.Round)
		}
		if len(ruling.Wrong) > 0 {
			r.convict(key, c, ruling)
		}
		if ruling.Mark == h.mark(key) {
			if len(h.cases) == 0 {
				delete(r.checks.doubted, h.worker)
			}
			r.settle(h)
		}
	case check.Disputed:
		h.since = r.c.options.Now()
		r.c.flag(h.worker)
		return r.evidence(key, c) + "; a third worker decides"
	case check.Hung:
		complaint = r.evidence(key, c)
		r.pauseFor(complaint + "; no two agree: replace the bad workers, then resume the job")
	}
	return complaint
}

// convict excludes who was wrong. Requires: mu; the case is closed.
func (r *run) convict(key segmentKey, c *check.Case, ruling check.Ruling) {
	evidence := r.evidence(key, c)
	c.Heard = c.Heard[:2] // the third was never in dispute
	for _, worker := range ruling.Wrong {
		r.acquit(c, worker)
		r.exclude(worker, evidence)
	}
}

// acquit takes the flag back from who was in dispute with a worker that is found wrong.
func (r *run) acquit(c *check.Case, wrong string) {
	if !c.Knows(wrong) || c.Ruling().Status != check.Disputed {
		return
	}
	for _, t := range c.Heard {
		if t.Worker != wrong {
			r.c.unflag(t.Worker)
		}
	}
}

// evidence says who rendered a segment to what.
func (r *run) evidence(key segmentKey, c *check.Case) string {
	var said []string
	for _, t := range c.Heard {
		said = append(said, fmt.Sprintf("worker %s has digest %016x (states %x)",
			r.c.describe(t.Worker), t.Mark.Digest, t.Mark.Evidence[:4]))
	}
	return fmt.Sprintf("segment %d of round %d was rendered differently: %s", key.segment, key.round, strings.Join(said, ", "))
}

// exclude keeps a worker from all further work. Requires: mu.
func (r *run) exclude(worker, evidence string) {
	reason := fmt.Sprintf("job %s: %s; %d other segments of the worker were counted unchecked in this job",
		r.id, evidence, r.checks.unchecked[worker])
	r.c.exclude(worker, reason)
	r.publish("fault", fmt.Sprintf("worker %s is excluded: %s", r.c.describe(worker), evidence), nil, slog.String("worker", worker))
	r.expel(worker)
	r.save()
}

// expel undoes what can be undone of an excluded worker's part in this job. Requires: mu.
func (r *run) expel(worker string) {
	for _, h := range slices.Clone(r.checks.held) {
		for _, c := range h.cases {
			r.acquit(c, worker)
			c.Withdraw(worker)
		}
		if h.worker == worker {
			r.drop(h)
		}
	}
	r.c.metrics.released.Add(float64(r.table.ReleaseWorker(worker)))
	if n := r.checks.unchecked[worker]; n > 0 {
		delete(r.checks.unchecked, worker)
		r.warn(fmt.Sprintf("%d segments of worker %s, which was found to render wrong, are in the image unchecked; "+
			"to be sure, repeat the job from its resolved spec", n, r.c.describe(worker)))
	}
}

// doubt has all checked that the parties to undecided cases of a batch deliver, and lists them: nobody will
// decide. Requires: mu.
func (r *run) doubt(h *heldBatch) (parties []string) {
	for _, c := range h.cases {
		if status := c.Ruling().Status; status != check.Disputed && status != check.Hung {
			continue
		}
		for _, t := range c.Heard {
			r.checks.doubted[t.Worker] = true
			parties = append(parties, t.Worker)
		}
	}
	return parties
}

// pauseFor pauses a job that cannot go on without its user; all held batches are dropped. Requires:
// mu.
func (r *run) pauseFor(reason string) {
	for _, h := range slices.Clone(r.checks.held) {
		for _, worker := range r.doubt(h) {
			r.checks.suspects[worker] = true
		}
		r.drop(h)
	}
	r.rec.Paused, r.rec.PauseReason = true, reason
	r.stopClock()
	r.publish("fault", "paused: "+reason, nil)
	r.publish("state", "paused", nil)
	r.save()
}

// unpause lets a job go on. Requires: mu; the caller saves.
func (r *run) unpause() {
	r.rec.Paused, r.rec.PauseReason = false, ""
	clear(r.checks.suspects)
	for _, h := range r.checks.held {
		h.since = r.c.options.Now()
	}
	r.startClock()
}

// reviewHeld looks after held batches whose checks do not come. Requires: mu.
func (r *run) reviewHeld() {
	warnings := len(r.rec.Warnings)
	defer func() {
		if len(r.rec.Warnings) != warnings {
			r.save()
		}
	}()
	for worker := range r.c.excluded() {
		r.expel(worker)
	}
	if r.rec.State != job.Rendering || r.rec.Paused {
		return
	}
	for _, h := range slices.Clone(r.checks.held) {
		overdue := r.c.options.Now().Sub(h.since) > r.c.options.CheckPatience
		switch {
		case h.disputed() && overdue:
			r.pauseUndecided(h)
			return
		case h.disputed() || r.checks.disputes(h.worker):
		default:
			r.release(h, overdue)
		}
	}
}

// pauseUndecided requires: mu; the batch is disputed.
func (r *run) pauseUndecided(h *heldBatch) {
	for key, c := range h.cases {
		if c.Ruling().Status == check.Disputed {
			r.pauseFor(fmt.Sprintf("%s; no third worker decided within %v: add a worker or remove the bad one, then resume the job",
				r.evidence(key, c), r.c.options.CheckPatience))
			return
		}
	}
}

// release closes the cases that nobody is there to render, all of them if they are overdue, and
// merges the batch if that was the last. Requires: mu.
func (r *run) release(h *heldBatch, overdue bool) {
	workers := r.c.renderers(r.spec.GetWorkerVersion())
	for key := range h.cases {
		suits := func(worker string) bool { return r.table.Suits(r.checkTask(key), worker) }
		if overdue || !slices.ContainsFunc(workers, suits) {
			r.closeCase(h, key)
			r.publish("fault", fmt.Sprintf("segment %d of round %d stays unchecked: no second worker rendered it", key.segment, key.round), nil,
				slog.Int("round", key.round), slog.Int("segment", key.segment))
		}
	}
	if len(h.cases) == 0 {
		r.settle(h)
		r.c.announce()
	}
}
