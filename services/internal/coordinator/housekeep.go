package coordinator

import (
	"fmt"
	"maps"
	"slices"
	"strings"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

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
		r.keep()
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
		snapshot, unwound := r.completeSnapshot()
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
		r.adopt(snapshot, unwound, point)
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

// completeSnapshot returns the state if its first open round is complete and undisputed, and how often open
// rounds were thrown away by then.
func (r *run) completeSnapshot() (snapshot *render.State, unwound uint64) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State != job.Rendering || r.finishing != nil || !r.state.Complete() || r.contested() || !r.mayAct() {
		return nil, 0
	}
	return r.state.Snapshot(), r.rec.Unwound
}

func (r *run) adopt(folded *render.State, unwound uint64, point job.ConvergencePoint) {
	r.mu.Lock()
	defer r.mu.Unlock()
	// Meanwhile it may have been canceled or lost, or a worker may have contradicted what was counted.
	if r.rec.State != job.Rendering || !r.mayAct() || r.contested() || r.rec.Unwound != unwound {
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
	maps.DeleteFunc(r.checks.by, func(key segmentKey, _ countedBy) bool { return key.round < r.state.Closed-1 })
	r.c.log.Info("round complete", "job", r.id, "round", point.Round, "rel_mse", point.RelMSE, "film_sha256", point.FilmSHA256)
	r.warnOfTrapped(&r.state.Account.Counts)
	decision, last := round.Decide(r.rec.Request.Stop, r.spec.GetRoundSizes(), plan.PerPixel(r.spec), relErrors(r.state.Points), r.rec.Decision)
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
	r.warn(fmt.Sprintf("%s: the longest stay so far has %d mutations, trapped by now: %d of the chains; another "+
		"integrator or more large steps may help", trappedWarning, counts.LongestStay, counts.TrappedNow()))
}

// trappedWarning begins the warning of trapped chains.
var trappedWarning = fmt.Sprintf("chains do not move for %d mutations and more", tally.TrappedAfter)

func isTrappedWarning(text string) bool { return strings.HasPrefix(text, trappedWarning) }

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
