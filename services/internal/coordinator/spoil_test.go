package coordinator

import (
	"errors"
	"math"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// expectWhole fails where the coordinator is about to end.
func expectWhole(t *testing.T, c *Coordinator) {
	t.Helper()
	select {
	case err := <-c.broken:
		t.Fatalf("the coordinator ends: %v", err)
	default:
	}
}

func TestANumberThatCannotBeStoredFailsItsJobOnly(t *testing.T) {
	r := openRun(t, nil)
	r.mu.Lock()
	r.setState(job.Rendering, "")
	r.extra.LoadSeconds = math.NaN()
	r.warn("before")
	r.publish("round", "round 0", &job.ConvergencePoint{BStandardError: math.Inf(1)})
	if r.save() || r.mayAct() {
		t.Error("the job was stored, or goes on without")
	}
	r.save() // who saved it may do so again
	r.mu.Unlock()
	expectWhole(t, r.c)
	r.c.housekeep()
	expectWhole(t, r.c)
	stored, err := r.c.options.Store.Job(t.Context(), r.id)
	if err != nil || stored.State != job.Failed || !strings.Contains(stored.Error, "a number that is infinite or none") ||
		stored.Summary == nil || stored.Summary.State != job.Failed || len(stored.Warnings) != 1 {
		t.Errorf("stored %+v, error %v", stored.Record, err)
	}
	events, err := r.c.options.Store.Events(t.Context(), r.id, 0)
	if err != nil || len(events) != 4 || events[2].Message != "round 0" || events[2].Convergence != nil || events[3].Job.State != job.Failed {
		t.Errorf("events %+v, error %v", events, err)
	}
	if r.c.running(r.id) != nil {
		t.Error("the job is still owned")
	}
}

func TestAJobThatHasEndedIsStoredWithoutItsNumbers(t *testing.T) {
	r := openRun(t, nil)
	r.mu.Lock()
	r.setState(job.Rendering, "")
	r.extra.LoadSeconds = math.NaN()
	r.end(job.Canceled, "by the user")
	r.mu.Unlock()
	r.c.housekeep()
	expectWhole(t, r.c)
	stored, err := r.c.options.Store.Job(t.Context(), r.id)
	if err != nil || stored.State != job.Canceled || stored.Summary == nil || stored.Summary.State != job.Canceled {
		t.Errorf("stored %+v, error %v", stored.Record, err)
	}
}

func TestAJobThatCannotBeStoredAtAllIsDropped(t *testing.T) {
	r := openRun(t, nil)
	r.mu.Lock()
	r.rec.Request.Stop.TimeSeconds = math.NaN()
	r.save()
	r.mu.Unlock()
	r.c.housekeep()
	expectWhole(t, r.c)
	if r.c.running(r.id) != nil {
		t.Error("the job is still owned")
	}
	if stored, err := r.c.options.Store.Job(t.Context(), r.id); err != nil || stored.State != job.Queued {
		t.Errorf("stored %+v, error %v", stored.Record, err)
	}
}

func TestOtherErrorsOfTheStoreEndTheCoordinator(t *testing.T) {
	r := openRun(t, nil)
	r.c.trouble(errors.New("the disk is gone"))
	select {
	case <-r.c.broken:
	default:
		t.Error("it goes on")
	}
	r.c.trouble(store.ErrUnavailable)
	expectWhole(t, r.c)
}
