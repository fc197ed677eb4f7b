package coordinator

import (
	"context"
	"errors"
	"fmt"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/store"
)

// retirePatience is how long a refinement waits for a job that has just ended to be stored with its
// last checkpoint.
const retirePatience = 10 * time.Second

// Refine implements api.Service. The job goes on from its last checkpoint as the job that would have
// been submitted with these stop rules (render.State.Extend), under a new number of refinements. The
// record says so before the call returns; the checkpoint stays as it is, and whoever reads it extends
// it to the rules of the record, so that nothing is lost wherever the coordinator dies.
func (c *Coordinator) Refine(ctx context.Context, id string, stop job.StopRules) (job.Snapshot, error) {
	r, err := c.atRest(ctx, id)
	if err != nil {
		return job.Snapshot{}, err
	}
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.refinedTo(stop) {
		if r.behind {
			return job.Snapshot{}, fmt.Errorf("job %s: %w", id, store.ErrUnavailable)
		}
		return r.snapshot(), nil // the call is repeated
	}
	if err := refinable(&r.rec); err != nil {
		return job.Snapshot{}, err
	}
	if r.epoch != 0 { // it has ended since it was looked at
		return job.Snapshot{}, fmt.Errorf("job %s is still being stored: %w", id, job.ErrUnavailable)
	}
	if err := c.checkCrowd(r.user, 1); err != nil {
		return job.Snapshot{}, err
	}
	request, err := r.rec.Request.Refined(stop, r.rec.State == job.Canceled)
	if err != nil {
		return job.Snapshot{}, err
	}
	done, err := c.readers.enter(ctx, r.id, r.rec.FilmBytes, c.options.ReadPatience)
	if err != nil {
		return job.Snapshot{}, err
	}
	defer done()
	saved, err := c.readCheckpoint(ctx, r.rec)
	switch {
	case unusable(err):
		return job.Snapshot{}, fmt.Errorf("job %s: its checkpoint cannot be used: %w: %w", id, job.ErrConflict, err)
	case err != nil:
		return job.Snapshot{}, fmt.Errorf("refine: %w", err)
	}
	if err := r.load(saved); err != nil {
		return job.Snapshot{}, fmt.Errorf("refine: %w", err)
	}
	if r.rec.Summary != nil { // it ended after its last checkpoint was begun
		r.extra.WallSeconds = max(r.extra.WallSeconds, r.rec.Summary.WallSeconds)
	}
	r.rec.Request = request
	if err := r.asksForMore(r.extend()); err != nil {
		return job.Snapshot{}, err
	}
	return c.reopen(ctx, r)
}

// atRest returns a job as it is stored, or live if it has not ended.
func (c *Coordinator) atRest(ctx context.Context, id string) (*run, error) {
	ctx, cancel := context.WithTimeout(ctx, retirePatience)
	defer cancel()
	for {
		r := c.running(id)
		if r == nil {
			return c.find(ctx, id)
		}
		if !r.view().State.Ended() {
			return r, nil
		}
		c.wake()
		select {
		case <-ctx.Done():
			return nil, fmt.Errorf("job %s is still being stored: %w", id, job.ErrUnavailable)
		case <-time.After(c.options.Tick):
		}
	}
}

// refinedTo tells whether the job was refined to these rules already. Requires: mu.
func (r *run) refinedTo(stop job.StopRules) bool {
	return r.rec.Refinements > 0 && r.rec.Request.Stop == stop && r.rec.State != job.Canceled
}

// refinable tells what keeps a job from going on.
func refinable(rec *store.Record) error {
	problem := ""
	switch {
	case !rec.State.Ended():
		problem = "only jobs that have ended can be refined"
	case rec.State == job.Failed:
		problem = "a job that failed cannot go on"
	case rec.StopReason == round.StopBlack || rec.Request.InspectOnly:
		problem = "there is nothing to refine"
	case rec.Checkpoint == "":
		problem = "it has no checkpoint to go on from; submit it again"
	default:
		return nil
	}
	return fmt.Errorf("job %s is %s: %s: %w", rec.ID, rec.State, problem, job.ErrConflict)
}

// extend makes the rounds those of a job that was submitted with the record's stop rules. It returns
// false if more is rendered already. Requires: mu; the checkpoint is loaded.
func (r *run) extend() bool {
	spec := plan.Extend(r.spec, r.rec.Request, r.report)
	if !r.state.Extend(spec) {
		return false
	}
	r.spec = spec
	return true
}

// asksForMore checks that a job that was submitted with the rules of the record would not have ended
// by now: it could not go back to where it would have. Requires: mu; the checkpoint is loaded.
func (r *run) asksForMore(extended bool) error {
	request := r.rec.Request
	if err := r.c.options.Limits.Check(r.spec, request, r.report); err != nil {
		return err
	}
	if limit := request.Stop.TimeSeconds; limit > 0 && limit <= r.wallSeconds() {
		return notMore(request.Stop, round.StopTime, fmt.Sprintf("the job has taken %.1f s", r.wallSeconds()))
	}
	done := "all rounds that there are have been rendered"
	if r.rec.Request.Resolved != "" {
		done = "the resolved spec that the job repeats has no more rounds"
	}
	if cut := r.state.SamplesBefore(r.state.Closed); r.state.Cut != nil && r.state.Chains() && cut%plan.CutMultiple != 0 {
		return fmt.Errorf("job %s ended after %d mutations of each chain, where no bit-identical image goes on (not a "+
			"multiple of %d): submit it again: %w", r.id, cut, plan.CutMultiple, job.ErrConflict)
	}
	if !extended {
		return notMore(request.Stop, round.StopCount, "more than that has been rendered")
	}
	errors := relErrors(r.state.Points)
	for n := 1; n <= len(errors); n++ {
		decision, last := round.Decide(request.Stop, r.spec.GetRoundSizes(), plan.PerPixel(r.spec), errors[:n], nil)
		if !last {
			continue
		}
		if decision.Reason != round.StopCount {
			done = fmt.Sprintf("this was reached with round %d", decision.Round)
		}
		return notMore(request.Stop, decision.Reason, done)
	}
	return nil
}

// notMore names the rule that asks for no more than there is.
func notMore(stop job.StopRules, reason, done string) error {
	field := "stop.target_error"
	switch {
	case reason == round.StopTime:
		field = "stop.time_seconds"
	case reason == round.StopRounds:
		field = "stop.rounds"
	case reason == round.StopError:
	case stop.MutationsPerPixel > 0:
		field = "stop.mutations_per_pixel"
	case stop.SamplesPerPixel > 0:
		field = "stop.samples_per_pixel"
	case stop.Rounds > 0:
		field = "stop.rounds"
	case stop.TimeSeconds > 0 && stop.TargetError == 0:
		field = "stop.time_seconds"
	}
	return &job.FieldError{Field: field, Detail: "asks for no more than there is: " + done}
}

// reopen acquires a job and lets it go on. Requires: r.mu; r is the stored job, extended, and not
// known to anybody else.
func (c *Coordinator) reopen(ctx context.Context, r *run) (job.Snapshot, error) {
	c.endedMu.Lock()
	defer c.endedMu.Unlock()
	if !c.room.enter(r, r.rec.Request.Priority, r.rec.FilmBytes, (*run).mayGoOn) {
		return job.Snapshot{}, fmt.Errorf("job %s is %s: %w", r.id, r.waitsForRoom(), job.ErrUnavailable)
	}
	epoch, err := c.acquireEnded(ctx, &r.rec)
	if err != nil {
		c.room.remove(r)
		return job.Snapshot{}, fmt.Errorf("refine: %w", err)
	}
	r.epoch = epoch
	r.gone.Store(false)
	was := r.rec.State
	r.rec.Refinements++
	r.rec.Decision, r.rec.StopReason, r.rec.Error = nil, "", ""
	r.rec.EndedAt, r.rec.Summary, r.rec.Convergence = nil, nil, nil
	r.rec.Paused, r.rec.PauseReason = false, ""
	c.insert(r)
	r.setState(job.Rendering, fmt.Sprintf("refined: goes on to %s", r.rec.Request.Stop))
	r.startClock()
	r.openTasks()
	r.dirty = true
	c.mu.Lock()
	if c.ended[was] > 0 { // it may have ended with another coordinator
		c.ended[was]--
	}
	c.mu.Unlock()
	defer c.announce()
	c.log.InfoContext(ctx, "job refined", "job", r.id, "epoch", epoch, "stop", r.rec.Request.Stop.String())
	if !r.save() {
		return job.Snapshot{}, fmt.Errorf("job %s: %w", r.id, store.ErrUnavailable)
	}
	return r.snapshot(), nil
}

// acquireEnded makes this coordinator the owner of a job that has ended, unless it has changed since
// the record was read. Requires: endedMu.
func (c *Coordinator) acquireEnded(ctx context.Context, rec *store.Record) (epoch uint64, err error) {
	if c.running(rec.ID) != nil {
		return 0, fmt.Errorf("job %s has changed meanwhile: %w", rec.ID, job.ErrUnavailable)
	}
	now, epoch, err := c.options.Store.Acquire(ctx, c.claim(), rec.ID)
	switch {
	case errors.Is(err, store.ErrOwned):
		return 0, fmt.Errorf("%w: %w", job.ErrUnavailable, err)
	case err != nil:
		return 0, err
	case now.Revision != rec.Revision:
		err = fmt.Errorf("job %s has changed meanwhile: %w", rec.ID, job.ErrUnavailable)
		return 0, errors.Join(err, c.options.Store.Release(ctx, epoch, rec.ID))
	}
	return epoch, nil
}
