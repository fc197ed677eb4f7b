package coordinator

import (
	"context"
	"errors"
	"fmt"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/lease"
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
	verdict, err := r.state.Judge(batch)
	switch {
	case err != nil:
		d.reject(err.Error())
	case verdict == round.Fresh:
		d.commit(batch)
		d.c.metrics.mergeSeconds.Observe(time.Since(start).Seconds())
	case verdict == round.Duplicate:
		d.decide(farmv1.Outcome_OUTCOME_DUPLICATE, "")
	case verdict == round.Conflict:
		d.conflict("a segment was counted with another digest")
	default:
		d.release()
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "part of it was counted before, or its round is not wanted")
	}
}

// commit requires: run.mu.
func (d *Delivery) commit(batch *merge.Batch) {
	r := d.run
	if batch.Round > r.lastRound() {
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "the round is not wanted any more")
		return
	}
	r.state.Commit(batch)
	var mutations uint64
	for _, s := range batch.Segments {
		mutations += s.Counts.Mutations
		d.c.metrics.rays.Add(float64(s.Counts.Rays))
		// Close by segment, not by the reported lease: whoever holds the task, it is done.
		r.closeTask(segmentTask(r.id, batch.Round, s.Segment))
		if batch.Round == r.state.Closed {
			r.openSegment(batch.Round+1, s.Segment)
		}
	}
	r.reportAnomalies(batch.Anomalies)
	r.dirty = true
	now := d.c.options.Now()
	r.meter.add(mutations, now)
	d.c.credit(d.worker.id, mutations)
	d.c.metrics.mutations.Add(float64(mutations))
	if r.state.Complete() {
		d.c.wake()
	}
	d.decide(farmv1.Outcome_OUTCOME_COMMITTED, "")
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

// release gives the batch's leases back without blame. Requires: run.mu.
func (d *Delivery) release() {
	for _, s := range d.header.GetSegments() {
		d.run.table.Release(lease.Ref{Task: s.GetLease().GetTaskId(), Epoch: s.GetLease().GetEpoch()}, d.worker.id)
	}
}

func (d *Delivery) decide(outcome farmv1.Outcome, message string) {
	d.verdict = &farmv1.DeliverResponse{Outcome: outcome, Message: message}
	d.c.log.Debug("batch", "job", d.header.GetJobId(), "round", d.header.GetRound(), "worker", d.worker.id,
		"segments", len(d.header.GetSegments()), "outcome", outcome.String(), "message", message)
}
