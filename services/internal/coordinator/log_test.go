package coordinator_test

import (
	"slices"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// TestTheLogTellsWhatHappened reads it after a takeover and after the end.
func TestTheLogTellsWhatHappened(t *testing.T) {
	s := newSite(t)
	s.start()
	dismiss := s.crew(workers(2, slowly)...)
	id := s.submit(chainsRequest(100))
	s.await(id, "in its second round", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	s.kill()
	s.start()
	defer s.stop()
	s.finished(id)
	dismiss()
	events, _, err := s.c.Events(t.Context(), id, 0)
	s.check(err)
	for _, want := range []struct {
		kind, message string
		attributes    []string
	}{
		{"log", "worker joins", []string{"worker", "worker_name", "worker_version", "threads"}},
		{"log", "planned", []string{"integrator", "chains", "rounds", "first_round", "unit", "b", "stop"}},
		{"log", "checkpoint", []string{"number", "round", "bytes", "seconds"}},
		{"state", "goes on with the job", nil},
		{"round", "round 2", nil},
		{"state", "count", nil},
	} {
		at := slices.IndexFunc(events, func(e job.Event) bool { return e.Kind == want.kind && strings.Contains(e.Message, want.message) })
		if at < 0 {
			t.Errorf("nothing says %q", want.message)
			continue
		}
		e := events[at]
		for _, name := range want.attributes {
			if e.Attributes[name] == nil {
				t.Errorf("%q has no %s: %v", want.message, name, e.Attributes)
			}
		}
		if e.Coordinator == "" || e.Epoch == 0 {
			t.Errorf("%q: coordinator %q, epoch %d", want.message, e.Coordinator, e.Epoch)
		}
	}
	if first, last := events[0].Epoch, events[len(events)-1].Epoch; first >= last || len(events) > store.MaxEvents {
		t.Errorf("epochs %d to %d, %d events", first, last, len(events))
	}
}
