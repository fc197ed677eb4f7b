package coordinator

import (
	"context"
	"errors"
	"io"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/round"
)

// Checkpoints are written, and those before them deleted, in a goroutine per job, and read when a job is
// taken over likewise, so that a transfer that hangs holds up no other job, nor the leases on them. How
// many go on at a time is bounded: each takes the memory and the time of a film.
//
// Whoever releases a job or gives it up ends its transfer first, or waits for it: nothing is written for a
// job after it was released. What is written for one that was lost meanwhile is named by no record.

const (
	// checkpointShare is the reciprocal of the time that checkpoints may take while a job goes on; with the
	// one at its end all of them stay below one hundredth.
	checkpointShare = 200
	// blobTimeout bounds one transfer of a checkpoint.
	blobTimeout = 5 * time.Minute
	// maxReads and maxWrites are how many checkpoints are read and written at a time.
	maxReads  = 2
	maxWrites = 4
)

// transfer is the writing of a checkpoint, and the deletion of what it replaces.
type transfer struct {
	cancel context.CancelFunc
	done   chan struct{} // closed when it has ended
}

// begin makes a transfer the one that is under way. Requires: there is none. It ends with no caller: the
// last checkpoints are written when all else has been canceled.
func (r *run) begin() (ctx context.Context, end func()) {
	ctx, cancel := context.WithTimeout(context.Background(), blobTimeout)
	t := &transfer{cancel: cancel, done: make(chan struct{})}
	r.transfer.Store(t)
	return ctx, func() {
		cancel()
		r.transfer.Store(nil)
		close(t.done)
	}
}

// cancelTransfer ends the transfer that is under way, if one is, and returns what is closed then.
func (r *run) cancelTransfer() (done <-chan struct{}) {
	t := r.transfer.Load()
	if t == nil {
		return nil
	}
	t.cancel()
	return t.done
}

// keep begins to write a checkpoint that is due and to delete what is not needed any more, unless that is
// under way or too many others are: then the next tick looks again. Only housekeeping calls it.
func (r *run) keep() {
	if r.transfer.Load() != nil || !r.checkpointDue(false) && !r.litters() {
		return
	}
	select {
	case r.c.writes <- struct{}{}:
	default:
		return
	}
	ctx, end := r.begin()
	r.c.transfers.Go(func() {
		if r.checkpointDue(false) {
			r.checkpoint(ctx)
		}
		r.sweep(ctx)
		end()
		<-r.c.writes
		r.c.wake() // the job may be over
	})
}

// keepLast writes the checkpoint with which the coordinator leaves a job, after the one under way.
// Requires: housekeeping has ended.
func (r *run) keepLast() {
	if t := r.transfer.Load(); t != nil {
		<-t.done
	}
	if r.c.suspended() || !r.catchUp() || !r.checkpointDue(true) {
		return
	}
	r.c.writes <- struct{}{}
	ctx, end := r.begin()
	r.checkpoint(ctx)
	end()
	<-r.c.writes
}

// checkpointDue tells whether a checkpoint should be written now: at the end of a job, when the
// last one has paid for itself, or when the coordinator leaves and there is something to keep.
func (r *run) checkpointDue(leaving bool) bool {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.state == nil || !r.mayAct() || r.c.options.Now().Before(r.retryAt) && !leaving {
		return false
	}
	if r.finishing != nil || r.rec.State.Ended() || leaving {
		return r.dirty || r.finishing != nil
	}
	interval := min(max(checkpointShare*r.checkpointCost, r.c.options.CheckpointMin), r.c.options.CheckpointMax)
	return r.dirty && r.c.options.Now().Sub(r.lastCheckpoint) >= interval
}

// litters tells whether there is something to sweep.
func (r *run) litters() bool {
	r.mu.Lock()
	defer r.mu.Unlock()
	return len(r.garbage) > 0 && r.mayAct()
}

// draft is a checkpoint that is about to be written.
type draft struct {
	checkpoint.Checkpoint
	name      string
	finishing *round.Decision // why the job ends with it; nil if it goes on
	contested bool            // it holds a segment that workers disagree about
	uncounted uint64          // run.uncounted when it was made
}

// checkpoint writes the job's progress to a new blob, then swings the pointer to it. A job that has
// reached its last round becomes Done with that same step.
func (r *run) checkpoint(ctx context.Context) {
	start := time.Now()
	written := &meteredWriter{bytes: r.c.metrics.checkpointBytes}
	d := r.draft()
	if d.State == nil {
		return
	}
	err := r.c.options.Blobs.WriteBlob(ctx, d.name, func(w io.Writer) error {
		written.Writer, written.count = w, 0
		return checkpoint.Write(written, d.Checkpoint)
	})
	if err != nil {
		r.failedCheckpoint(ctx, err)
		return
	}
	cost := time.Since(start)
	r.c.metrics.checkpointSeconds.Observe(cost.Seconds())
	r.swing(d, cost, written.count)
}

// failedCheckpoint lets the job go on: it can be rendered again from the last checkpoint that was written.
func (r *run) failedCheckpoint(ctx context.Context, err error) {
	r.mu.Lock()
	defer r.mu.Unlock()
	r.dirty = true
	r.retryAt = r.c.options.Now().Add(r.c.options.CheckpointMin)
	if errors.Is(ctx.Err(), context.Canceled) { // nobody wants it any more
		return
	}
	r.c.metrics.checkpointFailures.Inc()
	r.c.log.Error("checkpoint failed", "job", r.id, "error", err)
	r.noteFailedCheckpoint(err)
}

func (r *run) draft() draft {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.state == nil || !r.mayAct() {
		return draft{}
	}
	r.dirty = false
	r.rec.Checkpoints++
	extra := r.extra
	extra.WallSeconds = r.wallSeconds()
	return draft{
		Checkpoint: checkpoint.Checkpoint{State: r.state.Snapshot(), Extra: extra},
		name:       r.checkpointName(), finishing: r.finishing, contested: r.contested(), uncounted: r.uncounted,
	}
}

// swing makes a written checkpoint the one to resume from. The one before is garbage once that is
// stored.
func (r *run) swing(d draft, cost time.Duration, bytes int) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.gone.Load() {
		return
	}
	if r.rec.Checkpoint != "" {
		r.garbage = append(r.garbage, r.rec.Checkpoint)
	}
	r.rec.Checkpoint = d.name
	if !d.contested && d.uncounted == r.uncounted && !r.contested() {
		r.rec.Contested = nil
	}
	r.checkpointCost = cost
	r.lastCheckpoint = r.c.options.Now()
	r.noteCheckpoint(d, bytes, cost)
	if d.finishing != nil && r.finishing == d.finishing && r.rec.State == job.Rendering {
		r.finishing = nil
		r.rec.StopReason = d.finishing.Reason
		r.setState(job.Done, d.finishing.Reason)
	}
	r.save()
}

// sweep deletes what the stored record does not name any more.
func (r *run) sweep(ctx context.Context) {
	r.mu.Lock()
	var garbage []string
	if r.mayAct() {
		garbage, r.garbage = r.garbage, nil
	}
	r.mu.Unlock()
	r.c.discard(ctx, garbage)
}

// discard deletes checkpoints that nobody needs. What it misses is swept later.
func (c *Coordinator) discard(ctx context.Context, names []string) {
	for _, name := range names {
		if err := c.options.Blobs.Delete(ctx, blob.Named, name); err != nil {
			c.log.Warn("old checkpoint stays until it is swept", "blob", name, "error", err)
		}
	}
}
