package coordinator

import (
	"context"
	"errors"
	"fmt"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/round"
)

// Delivery takes one batch in, message by message. Finish must be called exactly once.
type Delivery struct {
	c         *Coordinator
	run       *run
	worker    worker
	header    *farmv1.BatchHeader
	assembler *merge.Assembler
	verdict   *farmv1.DeliverResponse // known before the end: the rest is only read, not unpacked
	held      bool                    // a slot of c.slots
}

// StartDelivery opens a batch. It waits while too many others are being unpacked.
func (c *Coordinator) StartDelivery(ctx context.Context, in *farmv1.DeliverHeader) (*Delivery, error) {
	w, err := c.findWorker(in.GetWorkerId())
	if err != nil {
		return nil, err
	}
	d := &Delivery{c: c, worker: w, header: in.GetBatch()}
	c.mu.Lock()
	d.run = c.jobs[d.header.GetJobId()]
	c.mu.Unlock()
	if d.run == nil {
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "no such job")
		return d, nil
	}
	d.open()
	if d.verdict != nil {
		return d, nil
	}
	select {
	case c.slots <- struct{}{}:
		d.held = true
		return d, nil
	case <-ctx.Done():
		return nil, ctx.Err()
	}
}

// open checks the header against the job.
func (d *Delivery) open() {
	r := d.run
	r.mu.Lock()
	defer r.mu.Unlock()
	switch {
	case r.rec.State != job.Rendering || r.finishing != nil:
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "the job is "+string(r.rec.State))
		return
	case r.spec.GetWorkerVersion() != d.worker.version:
		d.reject("the job is rendered by workers of version " + r.spec.GetWorkerVersion())
		return
	}
	chains := 0
	if plan.Chains(r.spec) > 0 {
		chains = int(r.spec.GetGroupSize())
	}
	assembler, err := merge.NewAssembler(d.c.codec, plan.Shape(r.spec), chains, d.header)
	if err != nil {
		d.reject(err.Error())
		return
	}
	d.assembler = assembler
}

// Add takes tiles. Once the batch is known to be bad it does nothing.
func (d *Delivery) Add(tiles []*farmv1.Tile) {
	if d.verdict != nil {
		return
	}
	if err := d.assembler.Add(tiles); err != nil {
		d.run.mu.Lock()
		defer d.run.mu.Unlock()
		d.reject(err.Error())
	}
}

// Finish merges the batch, or not, and says what became of it. complete is false when the stream
// broke off: then nothing is merged.
func (d *Delivery) Finish(complete bool) *farmv1.DeliverResponse {
	if d.held {
		defer func() { <-d.c.slots }()
	}
	if d.verdict == nil && complete {
		d.settle()
		d.c.announce()
	}
	if d.verdict == nil {
		return nil
	}
	d.c.metrics.countBatch(d.verdict.GetOutcome(), len(d.header.GetSegments()))
	return d.verdict
}

func (d *Delivery) settle() {
	start := time.Now()
	batch, err := d.assembler.Finish()
	r := d.run
	r.mu.Lock()
	defer r.mu.Unlock()
	switch {
	case errors.Is(err, merge.ErrDigest):
		d.conflict(err.Error())
		return
	case err != nil:
		d.reject(err.Error())
		return
	case r.rec.State != job.Rendering || r.finishing != nil:
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "the job is "+string(r.rec.State))
		return
	}
	d.judge(batch)
	if d.verdict.GetOutcome() == farmv1.Outcome_OUTCOME_COMMITTED {
		d.c.metrics.mergeSeconds.Observe(time.Since(start).Seconds())
	}
}

// judge requires: run.mu.
func (d *Delivery) judge(batch *merge.Batch) {
	r := d.run
	if _, err := r.state.Judge(batch); err != nil {
		d.reject(err.Error())
		return
	}
	if r.distrusts(d.worker.id) {
		d.supersede("nothing is taken from this worker, see the job's events")
		return
	}
	if complaint := r.hear(d.worker, batch); complaint != "" {
		d.conflict(complaint)
		return
	}
	// Only now: what was heard may have merged held batches.
	verdict, err := r.state.Judge(batch)
	switch {
	case err != nil:
		d.reject(err.Error())
	case verdict == round.Duplicate:
		d.decide(farmv1.Outcome_OUTCOME_DUPLICATE, "")
	case verdict == round.Conflict:
		d.conflict("a segment was counted with another digest")
	case verdict == round.Superseded || batch.Round > r.lastRound() || r.checks.overlaps(batch):
		d.supersede("part of it was delivered before, or its round is not wanted")
	case r.checks.disputes(d.worker.id):
		d.supersede("another worker contradicts this one")
	default:
		d.accept(batch)
	}
}

// accept counts a batch, or holds it until another worker has confirmed what is to be checked of
// it. Requires: run.mu; nothing of it was counted.
func (d *Delivery) accept(batch *merge.Batch) {
	r := d.run
	selected := r.toCheck(d.worker, batch)
	switch {
	case len(selected) == 0:
		r.count(batch, d.worker.id)
		d.decide(farmv1.Outcome_OUTCOME_COMMITTED, "")
	case r.hold(d.worker, batch, selected):
		d.decide(farmv1.Outcome_OUTCOME_COMMITTED, "kept until another worker has rendered a part of it too")
	default:
		d.supersede("too many batches wait for another worker to render a part of them")
	}
}

// supersede requires: run.mu.
func (d *Delivery) supersede(message string) {
	for _, s := range d.header.GetSegments() {
		d.run.table.Release(ref(s.GetLease()), d.worker.id)
	}
	d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, message)
}

// conflict requires: run.mu.
func (d *Delivery) conflict(message string) {
	d.c.flag(d.worker.id)
	d.run.publish("fault", fmt.Sprintf("worker %s delivered a conflicting batch of round %d: %s", d.worker.name, d.header.GetRound(), message), nil)
	d.blame(message)
	d.decide(farmv1.Outcome_OUTCOME_CONFLICT, message)
}

// reject requires: run.mu.
func (d *Delivery) reject(message string) {
	d.blame(message)
	d.decide(farmv1.Outcome_OUTCOME_REJECTED, message)
}

// blame gives the batch's leases back as failed, so another worker tries them first. Requires:
// run.mu.
func (d *Delivery) blame(message string) {
	for _, s := range d.header.GetSegments() {
		if d.run.rec.State.Ended() {
			return
		}
		d.run.blame(s.GetLease(), d.worker, message)
	}
}

func (d *Delivery) decide(outcome farmv1.Outcome, message string) {
	d.verdict = &farmv1.DeliverResponse{Outcome: outcome, Message: message}
	d.c.log.Debug("batch", "job", d.header.GetJobId(), "round", d.header.GetRound(), "worker", d.worker.id,
		"segments", len(d.header.GetSegments()), "outcome", outcome.String(), "message", message)
}
