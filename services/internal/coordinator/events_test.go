package coordinator_test

import (
	"slices"
	"testing"

	"metrofarm/services/internal/job"
)

// lean fails for an event that repeats what may be megabytes and never changes.
func lean(t *testing.T, e job.Event) {
	t.Helper()
	if e.Job != nil && (e.Job.Resolved != "" || e.Job.Request.Resolved != "" || e.Job.Request.Defaults != nil) {
		t.Errorf("event %d (%s %q) repeats the spec or the scene's defaults", e.Sequence, e.Kind, e.Message)
	}
}

// Hundreds of events are kept of a job: none repeats its spec.
func TestEventsDoNotRepeatTheSpec(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, nil)...)()
	request := chainsRequest(60)
	request.Defaults = map[string]string{"size": "64"}
	id := s.submit(request)
	_, live, err := s.c.Events(t.Context(), id, 0)
	s.check(err)
	ended := s.finished(id)
	if ended.Resolved == "" || ended.Request.Defaults["size"] != "64" {
		t.Fatal("the job has no spec or no values for the scene's defaults")
	}
	for e := range live {
		lean(t, e)
		if e.Kind == "state" && e.Job.State.Ended() {
			break
		}
	}
	stored, err := s.db.Events(t.Context(), id, 0)
	s.check(err)
	if len(stored) == 0 {
		t.Fatal("nothing is stored")
	}
	for _, e := range stored {
		lean(t, e)
	}
	if again := s.job(id); again.Resolved != ended.Resolved || again.Request.Defaults["size"] != "64" {
		t.Error("the job lost its spec or its values")
	}
}

// Live readers get progress and images; who comes later reads what is stored, whole and in order.
func TestWhatIsForLiveReadersIsNotKept(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, slowly)...)()
	id := s.submit(chainsRequest(100))
	past, live, err := s.c.Events(t.Context(), id, 0)
	s.check(err)
	told := past
	var passing uint64 // sequence of the last event that is not kept
	for e := range live {
		told = append(told, e)
		if isPassing(e) {
			passing = e.Sequence
		}
		if e.Kind == "state" && e.Job.State.Ended() {
			break
		}
	}
	if passing == 0 {
		t.Fatal("a live reader got neither progress nor images")
	}
	kept := slices.DeleteFunc(told, isPassing)
	later := slices.IndexFunc(kept, func(e job.Event) bool { return e.Sequence > passing })
	s.reads(id, 0, kept)
	s.reads(id, passing, kept[later:])
}

func isPassing(e job.Event) bool { return e.Kind == "progress" || e.Kind == "image" }

// reads checks what is read above a sequence number: these events, perhaps more that came since.
func (s *site) reads(id string, after uint64, want []job.Event) {
	s.t.Helper()
	got, _, err := s.c.Events(s.t.Context(), id, after)
	s.check(err)
	same := func(a, b job.Event) bool { return a.Sequence == b.Sequence && a.Kind == b.Kind }
	if slices.ContainsFunc(got, isPassing) || len(got) < len(want) || !slices.EqualFunc(got[:len(want)], want, same) {
		s.t.Errorf("above %d there are %v, want %v", after, numbers(got), numbers(want))
	}
}

func numbers(events []job.Event) []uint64 {
	all := make([]uint64, len(events))
	for i, e := range events {
		all[i] = e.Sequence
	}
	return all
}
