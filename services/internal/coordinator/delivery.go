package coordinator

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"slices"
	"strings"
	"time"

	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/flow"
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
	begun     bool                    // counted as one of the worker's
	memory    int64                   // that the merge queue counts for it
	bytes     int                     // of the tiles so far, packed
}

// ErrBusy: a worker has as many deliveries under way as it may.
var ErrBusy = fmt.Errorf("%d batches of this worker are not answered yet", flow.MaxInFlight)

// Admit waits until one more batch may be read. Nothing of it need be in memory before.
func (c *Coordinator) Admit(ctx context.Context) (*Delivery, error) {
	c.metrics.queueBatches.Inc()
	select {
	case c.slots <- struct{}{}:
		return &Delivery{c: c}, nil
	case <-ctx.Done():
		c.metrics.queueBatches.Dec()
		return nil, ctx.Err()
	}
}

// Open takes the header in, and waits until there is memory for the tiles.
func (d *Delivery) Open(ctx context.Context, in *farmv1.DeliverHeader) error {
	var err error
	if d.worker, err = d.c.findWorker(in.GetWorkerId()); err != nil {
		return err
	}
	if d.begun = d.c.merging.Begin(d.worker.id); !d.begun {
		return ErrBusy
	}
	d.header = in.GetBatch()
	d.c.mu.Lock()
	d.run = d.c.jobs[d.header.GetJobId()]
	d.c.mu.Unlock()
	if d.run == nil {
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "no such job")
		return nil
	}
	d.open(unsound(d.header))
	if d.verdict != nil {
		return nil
	}
	memory := int64(proto.Size(d.header)) + merge.UnpackedBytes(int(d.header.GetTileCount()))
	if err := d.c.merging.Reserve(ctx, memory); err != nil {
		return err
	}
	d.memory = memory
	return nil
}

// open checks the header against the job; damage is what is wrong with its checksums.
func (d *Delivery) open(damage error) {
	r := d.run
	r.mu.Lock()
	defer r.mu.Unlock()
	switch {
	case damage != nil:
		d.damaged(farmv1.Outcome_OUTCOME_CONFLICT, damage.Error())
		return
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
		d.refuse(err)
		return
	}
	d.assembler = assembler
}

// Add takes tiles. Once the batch is known to be bad it does nothing.
func (d *Delivery) Add(tiles []*farmv1.Tile) {
	if d.verdict != nil {
		return
	}
	d.countTiles(tiles)
	if err := d.assembler.Add(tiles); err != nil {
		d.run.mu.Lock()
		defer d.run.mu.Unlock()
		d.refuse(err)
	}
}

// Finish merges the batch, or not, and says what became of it. complete is false when the stream
// broke off: then nothing is merged.
func (d *Delivery) Finish(complete bool) *farmv1.DeliverResponse {
	defer d.leave()
	if d.verdict == nil && complete {
		d.settle()
	}
	if d.verdict == nil {
		return nil
	}
	d.c.metrics.countBatch(d.verdict.GetOutcome(), len(d.header.GetSegments()))
	return d.verdict
}

// leave gives back what the batch took of the coordinator.
func (d *Delivery) leave() {
	if d.memory > 0 {
		d.c.merging.Free(d.memory)
	}
	if d.begun {
		d.c.merging.End(d.worker.id)
	}
	<-d.c.slots
	d.c.metrics.queueBatches.Dec()
	d.c.announce() // there may be new work, or leases that were withheld
}

func (d *Delivery) settle() {
	start := time.Now()
	batch, err := d.assembler.Finish()
	r := d.run
	r.mu.Lock()
	defer r.mu.Unlock()
	switch {
	case r.gone.Load():
		d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, "the job has moved to another coordinator")
		return
	case err != nil:
		d.refuse(err)
		return
	}
	r.batchSize.Add(d.bytes + proto.Size(d.header))
	if r.rec.State != job.Rendering || r.finishing != nil {
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
	if !r.current(batch) {
		d.supersede("a part of it was asked for before the job was refined or its round begun again")
		return
	}
	if err := r.misplaced(batch); err != nil {
		d.damaged(farmv1.Outcome_OUTCOME_CONFLICT, err.Error())
		return
	}
	if _, err := r.state.Judge(batch); err != nil {
		d.reject(err.Error())
		return
	}
	var err error
	if batch.CPUSeconds, err = r.cpuTime(d.worker, batch.CPUSeconds, d.leases()...); err != nil {
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
	// Only now: what was heard may have merged held batches, or thrown open rounds away.
	verdict, err := r.state.Judge(batch)
	switch {
	case !r.current(batch):
		d.supersede("its round is rendered again")
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

// current tells whether all of a batch was asked for since the job was refined last, and since open rounds
// were thrown away last: rounds may be others now, and chains elsewhere. Requires: mu.
func (r *run) current(batch *merge.Batch) bool {
	return !slices.ContainsFunc(batch.Segments, func(s merge.Segment) bool {
		return !strings.HasPrefix(s.Task, r.taskPrefix())
	})
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

// refuse says what is wrong with a batch, and whose fault that is. Requires: run.mu.
func (d *Delivery) refuse(err error) {
	switch {
	case errors.Is(err, merge.ErrDigest):
		d.damaged(farmv1.Outcome_OUTCOME_CONFLICT, err.Error())
	case errors.Is(err, merge.ErrDamaged):
		d.damaged(farmv1.Outcome_OUTCOME_REJECTED, err.Error())
	default:
		d.reject(err.Error())
	}
}

// leases under which the batch was rendered.
func (d *Delivery) leases() []*farmv1.LeaseRef {
	leases := make([]*farmv1.LeaseRef, 0, len(d.header.GetSegments()))
	for _, s := range d.header.GetSegments() {
		leases = append(leases, s.GetLease())
	}
	return leases
}

// release gives the batch's leases back without blame. Requires: run.mu.
func (d *Delivery) release() {
	for _, l := range d.leases() {
		if d.run.table.Release(ref(l), d.worker.id) {
			d.c.metrics.released.Inc()
		}
	}
}

// supersede requires: run.mu.
func (d *Delivery) supersede(message string) {
	d.release()
	d.decide(farmv1.Outcome_OUTCOME_SUPERSEDED, message)
}

// conflict tells of a batch that another worker contradicts, which is no fault of its tasks. Requires:
// run.mu.
func (d *Delivery) conflict(message string) {
	d.flag("conflicting", message)
	d.decide(farmv1.Outcome_OUTCOME_CONFLICT, message)
}

// flag holds a batch against its worker and not against its tasks. Requires: run.mu.
func (d *Delivery) flag(kind, message string, more ...slog.Attr) {
	d.c.flag(d.worker.id)
	about := append(identity(d.worker), slog.Int("round", int(d.header.GetRound())))
	d.run.publish("fault", fmt.Sprintf("worker %s delivered a %s batch of round %d: %s", d.worker.name, kind, d.header.GetRound(), message), nil,
		append(about, more...)...)
	d.release()
	d.run.save()
}

// reject tells of a batch that speaks against its tasks. Requires: run.mu.
func (d *Delivery) reject(message string) {
	for _, l := range d.leases() {
		if d.run.rec.State.Ended() {
			break
		}
		d.run.blame(l, d.worker, message)
	}
	d.decide(farmv1.Outcome_OUTCOME_REJECTED, message)
}

func (d *Delivery) decide(outcome farmv1.Outcome, message string) {
	d.verdict = &farmv1.DeliverResponse{Outcome: outcome, Message: message}
	d.c.log.Debug("batch", "job", d.header.GetJobId(), "round", d.header.GetRound(), "worker", d.worker.id,
		"segments", len(d.header.GetSegments()), "outcome", outcome.String(), "message", message)
}
