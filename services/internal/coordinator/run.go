package coordinator

import (
	"context"
	"errors"
	"fmt"
	"slices"
	"sync"
	"sync/atomic"
	"time"

	"google.golang.org/protobuf/proto"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/flow"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/lease"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/store"
)

// run is one job. Methods that say so require mu.
type run struct {
	c      *Coordinator
	id     string
	number uint64 // order of creation
	user   string // who submitted it
	epoch  uint64 // of the ownership
	// gone: this coordinator does not own the job, or not any more. Nothing of it may be stored.
	gone     atomic.Bool
	standing standing
	table    *lease.Table // its changes require mu

	mu        sync.Mutex
	rec       store.Record
	condemned bool     // it was spoiled
	behind    bool     // the store has not all of rec; nothing is done until it has
	spoiled   error    // why rec cannot be stored; housekeeping condemns the job for it
	loading   bool     // its checkpoint is being read
	parked    func()   // goes on with a job that waits for room; nil: it does not wait
	garbage   []string // blobs that the record does not name any more
	tasks     map[string]taskKey
	checks    checks
	// uncounted is how often something was taken back of open rounds: a checkpoint of before may have it.
	uncounted uint64

	// From inspection on.
	report *scenev1.SceneReport
	spec   *jobv1.ResolvedSpec // replaced, never changed: tasks under way share it
	// While bootstrapping.
	stage   stage
	samples *bootstrap.Samples
	boot    bootstrapped
	// While rendering, and after the end until the last checkpoint is written.
	state     *render.State
	finishing *round.Decision // the last round is folded, its checkpoint is being written
	extra     checkpoint.Extra
	emptySHA  string // of the film of a job without light

	activity     string
	runningSince time.Time // zero while the wall clock of rendering stands still
	meter        meter
	batchSize    flow.BatchSize
	warned       map[string]bool // worker versions already reported as unfit

	dirty          bool // there is something to checkpoint
	lastCheckpoint time.Time
	retryAt        time.Time // after a checkpoint failed
	checkpointCost time.Duration

	transfer atomic.Pointer[transfer] // under way

	events eventLog
	crew   map[string]bool // workers that the log said have joined
	noted  notedCheckpoints

	imageTurn *places    // for one who develops its image
	image     *job.Image // of the complete rounds, while rendering
}

// taskKey says what a task of the current phase is.
type taskKey struct {
	phase   job.State
	first   plan.Range // while bootstrapping
	round   int
	segment int
}

func (c *Coordinator) newRun(rec store.Record, epoch uint64) *run {
	r := &run{
		c: c, id: rec.ID, number: rec.Number, user: rec.User, epoch: epoch, rec: rec,
		tasks:  make(map[string]taskKey),
		checks: newChecks(),
		warned: make(map[string]bool),
		crew:   make(map[string]bool),
		events: eventLog{sequence: rec.Sequence, shown: rec.Sequence},

		imageTurn: newPlaces(1, 0, "another image of it is being developed"),
	}
	r.table = lease.NewTable(c.options.LeaseTTL, r.nextEpoch)
	r.updateStanding()
	return r
}

// nextEpoch of a task's lease grows over owners: the ownership's epoch is its high part.
func (r *run) nextEpoch() uint64 {
	return r.epoch<<32 | uint64(r.c.leases.Add(1))
}

// put opens a task. Requires: mu.
func (r *run) put(id string, order uint64, key taskKey) {
	r.tasks[id] = key
	r.table.Put(id, order)
}

// closeTask forgets a finished task. Requires: mu.
func (r *run) closeTask(id string) {
	r.table.Done(id, r.c.options.Now())
	delete(r.tasks, id)
}

// clearTasks drops all tasks: a phase is over. Requires: mu.
func (r *run) clearTasks() {
	r.table.Clear()
	clear(r.tasks)
	r.checks.clear(r.c.merging)
}

// startInspection opens the job's first task. Requires: mu.
func (r *run) startInspection() {
	r.put(r.id+"/inspect", 0, taskKey{phase: job.Inspecting})
}

// openTasks opens the tasks of all segments that can be rendered now. Requires: mu; rendering.
func (r *run) openTasks() {
	last := r.lastRound()
	for number := r.state.Closed; number <= min(r.state.Closed+1, last); number++ {
		for segment := range r.state.Expected() {
			r.openSegment(number, segment)
		}
	}
}

// openSegment opens one segment's task if it can be rendered now. Requires: mu; rendering.
func (r *run) openSegment(number, segment int) {
	held := r.checks.of[segmentKey{number, segment}] != nil
	if held || number > r.lastRound() || !r.state.Ready(number, segment) {
		return
	}
	key := taskKey{phase: job.Rendering, round: number, segment: segment}
	r.put(r.segmentTask(number, segment), r.segmentOrder(number, segment), key)
}

func (r *run) segmentOrder(number, segment int) uint64 {
	return uint64(number)*uint64(len(r.state.Expected())) + uint64(segment)
}

func (r *run) segmentTask(number, segment int) string {
	return fmt.Sprintf("%sr%d/s%d", r.taskPrefix(), number, segment)
}

// taskPrefix begins the names of the segments' tasks. Requires: mu.
func (r *run) taskPrefix() string {
	prefix := r.id + "/"
	if r.rec.Refinements > 0 {
		prefix += fmt.Sprintf("f%d/", r.rec.Refinements)
	}
	if r.rec.Unwound > 0 {
		prefix += fmt.Sprintf("u%d/", r.rec.Unwound)
	}
	return prefix
}

// lastRound is the last round that may be needed, as far as is known. Requires: mu; spec resolved.
func (r *run) lastRound() int {
	last := len(r.spec.GetRoundSizes()) - 1
	if rounds := r.rec.Request.Stop.Rounds; rounds > 0 {
		last = min(last, rounds-1)
	}
	if d := r.rec.Decision; d != nil {
		last = min(last, d.Round)
	}
	return last
}

// decideLast records that the round under way is the last one. Requires: mu.
func (r *run) decideLast(reason string) {
	if r.rec.Decision != nil || r.finishing != nil {
		return
	}
	number := 0
	if r.state != nil {
		number = r.state.Closed
	}
	r.rec.Decision = &round.Decision{Round: number, Reason: reason}
	r.save() // before it takes effect: a restart must stop on the same round
	for _, h := range slices.Clone(r.checks.held) {
		if h.batch.Round > number { // nobody decides about it any more
			r.doubt(h)
			r.forget(h)
			if h.counted {
				r.uncount(h.batch.Round)
			}
		}
	}
	for id, key := range r.tasks {
		if key.phase == job.Rendering && key.round > number {
			r.table.Drop(id)
			delete(r.tasks, id)
		}
	}
}

// setState changes the job's state. Requires: mu; the caller saves.
func (r *run) setState(next job.State, message string) {
	if err := r.rec.State.To(next); err != nil {
		r.c.log.Error("state machine", "job", r.id, "error", err)
		return
	}
	now := r.c.options.Now()
	if r.rec.StartedAt == nil {
		r.rec.StartedAt = &now
	}
	if next.Ended() {
		r.stopClock()
		r.rec.EndedAt = &now
	}
	r.rec.State = next
	r.activity = ""
	if next.Ended() {
		summary := r.snapshot()
		r.rec.Summary = &summary
		if r.state != nil {
			r.rec.Convergence = r.state.History()
		}
	}
	r.c.log.Info("job state", "job", r.id, "state", string(next), "message", message)
	r.publish("state", message, nil)
}

// fail ends the job with an error. Requires: mu.
func (r *run) fail(message string) {
	r.rec.Error = message
	r.end(job.Failed, message)
}

// end ends the job early; what is rendered stays. Housekeeping writes the last checkpoint.
// Requires: mu.
func (r *run) end(state job.State, message string) {
	r.discardContested()
	r.clearTasks()
	r.samples = nil
	r.setState(state, message)
	r.save()
	r.c.wake()
}

// warn adds a warning to the job. Requires: mu; the caller saves.
func (r *run) warn(text string) {
	r.rec.Warnings = append(r.rec.Warnings, text)
	r.publish("warning", text, nil)
}

// save makes the record and the events so far durable, and then shows the events. Where the store is
// out of reach the job stands still until housekeeping has saved it; where another coordinator owns
// the job it is dropped. The caller needs the result only if it goes on to destroy or to promise
// something. Requires: mu.
func (r *run) save() (saved bool) {
	r.updateStanding()
	if r.gone.Load() {
		return false
	}
	r.behind = true
	if r.c.down.Load() || r.spoiled != nil {
		return false
	}
	r.rec.Revision++
	r.rec.Sequence = r.events.sequence + sequenceReserve
	err := r.c.options.Store.UpdateJob(context.Background(), r.epoch, r.rec, r.events.unsaved)
	switch {
	case err == nil:
		r.behind = false
		r.events.unsaved = nil
		r.events.show()
		return true
	case errors.Is(err, store.ErrFenced), errors.Is(err, job.ErrNotFound):
		r.c.lose(r)
	case errors.Is(err, store.ErrNotJSON):
		r.spoil(err)
	default:
		r.c.trouble(err)
	}
	return false
}

// catchUp saves what is not saved yet, and tells whether the job may be acted on. Its tasks may have
// waited for that.
func (r *run) catchUp() bool {
	r.mu.Lock()
	defer r.mu.Unlock()
	held := r.behind
	if r.spoiled != nil {
		r.condemn()
	}
	if (r.behind || len(r.events.unsaved) > 0) && r.save() && held {
		r.c.announce()
	}
	return r.mayAct()
}

// mayAct tells whether the job is this coordinator's to act on. Requires: mu.
func (r *run) mayAct() bool { return !r.gone.Load() && !r.behind && !r.loading && !r.c.suspended() }

// startClock lets the wall time of rendering run. Requires: mu.
func (r *run) startClock() {
	if r.runningSince.IsZero() && r.rec.State == job.Rendering && !r.rec.Paused {
		r.runningSince = r.c.options.Now()
	}
}

// stopClock stops it. Requires: mu.
func (r *run) stopClock() {
	r.extra.WallSeconds = r.wallSeconds()
	r.runningSince = time.Time{}
}

// wallSeconds of rendering so far. Requires: mu.
func (r *run) wallSeconds() float64 {
	if r.runningSince.IsZero() {
		return r.extra.WallSeconds
	}
	return r.extra.WallSeconds + r.c.options.Now().Sub(r.runningSince).Seconds()
}

// pin fixes the version of the workers that render this job. Requires: mu; spec is resolved.
func (r *run) pin(version string) {
	if r.spec.GetWorkerVersion() != "" {
		return
	}
	r.spec = proto.CloneOf(r.spec)
	r.spec.WorkerVersion = version
	if r.state != nil {
		r.state.Spec = r.spec
		r.dirty = true
	}
}
