package coordinator

import (
	"context"
	"fmt"
	"io"
	"maps"
	"slices"
	"strings"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

// checkpointShare is the reciprocal of the time that checkpoints may take while a job goes on; with the
// one at its end all of them stay below one hundredth.
const checkpointShare = 200

// blobTimeout bounds one transfer of a checkpoint.
const blobTimeout = 5 * time.Minute

// blobContext is for transfers that end with no caller: the last checkpoints are written when all
// else has been canceled.
func blobContext() (context.Context, context.CancelFunc) {
	return context.WithTimeout(context.Background(), blobTimeout)
}

// housekeep does for every job what no call from outside does. It runs in one goroutine.
func (c *Coordinator) housekeep() {
	c.endLostStreams()
	c.forgetWorkers()
	if c.suspended() || c.down.Load() {
		return
	}
	for _, r := range c.runs() {
		if !r.catchUp() {
			continue
		}
		r.tick()
		r.closeRound()
		if r.checkpointDue(false) {
			r.checkpoint()
		}
		r.sweep()
		r.retire()
	}
	c.letIn()
}

// tick looks at the clock.
func (r *run) tick() {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State.Ended() || !r.mayAct() {
		return
	}
	r.expire()
	r.reviewHeld()
	limit := r.rec.Request.Stop.TimeSeconds
	if r.rec.State == job.Rendering && limit > 0 && r.wallSeconds() >= limit {
		r.decideLast(round.StopTime)
	}
	r.publishProgress()
}

// publishProgress tells live readers about a job at most once a second. Requires: mu.
func (r *run) publishProgress() {
	now := r.c.options.Now()
	if r.rec.State == job.Queued || r.rec.Paused || len(r.events.streams) == 0 || now.Sub(r.events.progressAt) < time.Second {
		return
	}
	r.events.progressAt = now
	r.publish("progress", "", nil)
}

// closeRound folds the first open round if it is complete, evaluates it and decides whether it was
// the last. The film-sized work happens on a snapshot: deliveries to the next round go on.
func (r *run) closeRound() {
	for {
		snapshot := r.completeSnapshot()
		if snapshot == nil {
			return
		}
		if err := snapshot.Fold(); err != nil {
			r.failWith(err)
			return
		}
		point, err := snapshot.Evaluate()
		if err != nil {
			r.failWith(err)
			return
		}
		r.adopt(snapshot, point)
		r.c.announce()
	}
}

func (r *run) failWith(err error) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if !r.rec.State.Ended() && r.mayAct() {
		r.fail(err.Error())
	}
}

func (r *run) completeSnapshot() *render.State {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State != job.Rendering || r.finishing != nil || !r.state.Complete() || !r.mayAct() {
		return nil
	}
	return r.state.Snapshot()
}

func (r *run) adopt(folded *render.State, point job.ConvergencePoint) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State != job.Rendering || !r.mayAct() { // canceled, or lost, meanwhile
		return
	}
	point.WallSeconds = r.wallSeconds()
	point.CPUSeconds += r.extra.BootstrapCPUSeconds
	point.Rays += r.extra.BootstrapRays
	point.PathEvaluations += r.extra.BootstrapEvaluations
	folded.Points = append(folded.Points, point)
	r.state.Adopt(folded)
	r.dirty = true
	maps.DeleteFunc(r.checks.proven, func(key segmentKey, _ round.Mark) bool { return key.round < r.state.Closed })
	r.c.log.Info("round complete", "job", r.id, "round", point.Round, "rel_mse", point.RelMSE, "film_sha256", point.FilmSHA256)
	r.warnOfTrapped(&r.state.Account.Counts)
	decision, last := round.Decide(r.rec.Request.Stop, r.spec.GetRoundSizes(), r.perPixel(), relErrors(r.state.Points), r.rec.Decision)
	if last {
		r.state.Drop()
		r.clearTasks()
		r.finishing = &decision
	} else {
		r.openTasks()
	}
	r.publish("round", fmt.Sprintf("round %d", point.Round), &point)
	r.publish("image", fmt.Sprintf("round %d", point.Round), nil)
	r.save()
}

// warnOfTrapped warns, once, of chains that did not move for very long: where one stays, the image
// has a bright spot and the rest of it is short of samples. Requires: mu; the caller saves.
func (r *run) warnOfTrapped(counts *tally.Counts) {
	if counts.ChainsTrapped == 0 || slices.ContainsFunc(r.rec.Warnings, isTrappedWarning) {
		return
	}
	r.warn(fmt.Sprintf("%s: the longest stay so far has %d mutations, %d chains are trapped by now; another "+
		"integrator or more large steps may help", trappedWarning, counts.LongestStay, counts.TrappedNow()))
}

// trappedWarning begins the warning of trapped chains.
var trappedWarning = fmt.Sprintf("chains do not move for %d mutations and more", tally.TrappedAfter)

func isTrappedWarning(text string) bool { return strings.HasPrefix(text, trappedWarning) }

// perPixel is what one unit of a round's size amounts to per pixel.
func (r *run) perPixel() float64 {
	if !r.state.Chains() {
		return 1
	}
	pixels := float64(r.spec.GetWidth()) * float64(r.spec.GetHeight())
	return float64(r.spec.GetChainGroups()) * float64(r.spec.GetGroupSize()) / pixels
}

// relErrors lists the errors by round, negative where unknown.
func relErrors(points []job.ConvergencePoint) []float64 {
	errors := make([]float64, len(points))
	for i, p := range points {
		errors[i] = -1
		if known(p) || p.RelMSE > 0 {
			errors[i] = p.RelMSE
		}
	}
	return errors
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

// checkpoint writes the job's progress to a new blob, then swings the pointer to it. A job that has
// reached its last round becomes Done with that same step.
func (r *run) checkpoint() {
	start := time.Now()
	written := &meteredWriter{bytes: r.c.metrics.checkpointBytes}
	c, name := r.checkpointSnapshot()
	if c.State == nil {
		return
	}
	ctx, cancel := blobContext()
	defer cancel()
	err := r.c.options.Blobs.WriteBlob(ctx, name, func(w io.Writer) error {
		written.Writer, written.count = w, 0
		return checkpoint.Write(written, c)
	})
	if err != nil {
		// The job goes on: it can be rendered again from the last checkpoint that was written.
		r.c.metrics.checkpointFailures.Inc()
		r.c.log.Error("checkpoint failed", "job", r.id, "error", err)
		r.mu.Lock()
		r.noteFailedCheckpoint(err)
		r.dirty = true
		r.retryAt = r.c.options.Now().Add(r.c.options.CheckpointMin)
		r.mu.Unlock()
		return
	}
	cost := time.Since(start)
	r.c.metrics.checkpointSeconds.Observe(cost.Seconds())
	r.swing(name, cost, written.count)
}

func (r *run) checkpointSnapshot() (checkpoint.Checkpoint, string) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.state == nil || !r.mayAct() {
		return checkpoint.Checkpoint{}, ""
	}
	r.dirty = false
	r.rec.Checkpoints++
	extra := r.extra
	extra.WallSeconds = r.wallSeconds()
	return checkpoint.Checkpoint{State: r.state.Snapshot(), Extra: extra}, r.checkpointName()
}

// swing makes a written checkpoint the one to resume from. The one before is garbage once that is
// stored.
func (r *run) swing(name string, cost time.Duration, bytes int) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.gone.Load() {
		return
	}
	if r.rec.Checkpoint != "" {
		r.garbage = append(r.garbage, r.rec.Checkpoint)
	}
	r.rec.Checkpoint = name
	r.checkpointCost = cost
	r.lastCheckpoint = r.c.options.Now()
	r.noteCheckpoint(bytes, cost)
	if d := r.finishing; d != nil && r.rec.State == job.Rendering {
		r.finishing = nil
		r.rec.StopReason = d.Reason
		r.setState(job.Done, d.Reason)
	}
	r.save()
}

// sweep deletes what the stored record does not name any more.
func (r *run) sweep() {
	r.mu.Lock()
	var garbage []string
	if r.mayAct() {
		garbage, r.garbage = r.garbage, nil
	}
	r.mu.Unlock()
	r.c.discard(garbage)
}

// discard deletes checkpoints that nobody needs. What it misses is swept later.
func (c *Coordinator) discard(names []string) {
	for _, name := range names {
		ctx, cancel := blobContext()
		if err := c.options.Blobs.Delete(ctx, blob.Named, name); err != nil {
			c.log.Warn("old checkpoint stays until it is swept", "blob", name, "error", err)
		}
		cancel()
	}
}
