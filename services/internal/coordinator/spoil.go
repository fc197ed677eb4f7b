package coordinator

import (
	"encoding/json"
	"fmt"

	"metrofarm/services/internal/checkpoint"
	"metrofarm/services/internal/job"
)

// A number that is infinite or none may get into what is known of a job, for all that is checked before.
// No store can hold it. That is the job's end and no other's: the store is well.

// spoil notes that the job cannot be stored as it is. It stands still until housekeeping, which calls
// condemn, since whoever saved it may not be done with it. Requires: mu.
func (r *run) spoil(err error) {
	if r.condemned { // and still it cannot
		r.c.log.Error("job cannot be stored at all and is dropped", "job", r.id, "error", err)
		r.c.drop(r)
		return
	}
	r.c.log.Error("job cannot be stored", "job", r.id, "error", err)
	r.spoiled = err
	r.c.wake()
}

// condemn fails the job, unless it has ended, and forgets what was measured: what is left can be stored.
// Its last checkpoint stays. Requires: mu; spoiled.
func (r *run) condemn() {
	why := r.spoiled
	r.spoiled, r.condemned = nil, true
	r.cancelTransfer()
	r.events.clean()
	r.discardContested()
	r.clearTasks()
	r.state, r.finishing, r.samples, r.extra, r.dirty = nil, nil, nil, checkpoint.Extra{}, false
	r.rec.Summary, r.rec.Convergence = nil, nil
	if !r.rec.State.Ended() {
		r.fail(fmt.Sprintf("the job has a number that is infinite or none: %v", why))
		return
	}
	summary := r.snapshot()
	r.rec.Summary = &summary
	r.save()
}

// clean leaves out of events what cannot be stored. Their messages can.
func (l *eventLog) clean() {
	for _, events := range [][]job.Event{l.recent, l.unsaved, l.hidden} {
		for i := range events {
			e := &events[i]
			if _, err := json.Marshal(e); err != nil {
				e.Job, e.Convergence, e.Attributes = nil, nil, nil
			}
		}
	}
}
