package coordinator_test

import (
	"slices"
	"testing"
	"time"

	"metrofarm/services/internal/job"
)

// follow reads a job's stream at a coordinator, beginning after what there is.
func (s *site) follow(id string) <-chan job.Event {
	s.t.Helper()
	past, live, err := s.c.Events(s.t.Context(), id, 0)
	s.check(err)
	if len(past) == 0 {
		s.t.Fatal("an ended job without events")
	}
	return live
}

// ends waits until a stream does.
func (s *site) ends(stream <-chan job.Event) {
	s.t.Helper()
	select {
	case event, open := <-stream:
		if open {
			s.t.Fatalf("%+v of a job at rest", event)
		}
	case <-time.After(patience):
		s.t.Fatal("the stream of a job that changed elsewhere stays open")
	}
}

// Jobs at rest are nobody's: what becomes of one is heard of by all who follow or list it.
func TestWhatBecomesOfAJobAtRestIsHeardEverywhere(t *testing.T) {
	t.Parallel()
	p := newPair(t, 600*time.Millisecond)
	first, second := p.sites[0], p.sites[1]
	first.start()
	defer first.stop()
	second.start()
	defer second.stop()
	defer first.crew(workers(1, nil)...)()
	quiet, id := first.submit(chainsRequest(20)), first.submit(chainsRequest(20))
	first.settled(quiet)
	first.settled(id)
	untouched := second.follow(quiet)
	streams := []<-chan job.Event{first.follow(id), second.follow(id)}
	first.refine(id, job.StopRules{MutationsPerPixel: 40})
	for i, s := range p.sites {
		s.ends(streams[i])
	}
	first.settled(id)
	if past, _, err := second.c.Events(t.Context(), id, 0); err != nil || !slices.ContainsFunc(past, func(e job.Event) bool {
		return e.Kind == "state" && e.Job != nil && e.Job.Refinements == 1
	}) {
		t.Errorf("who connects again reads nothing of the refinement, or error %v", err)
	}

	_, before := second.c.Deleted(0)
	streams = []<-chan job.Event{first.follow(id), second.follow(id)}
	first.check(first.c.Delete(t.Context(), id))
	for i, s := range p.sites {
		s.ends(streams[i])
		p.eventually("told", func() bool {
			ids, _ := s.c.Deleted(before)
			return slices.Contains(ids, id)
		})
	}
	select {
	case <-untouched:
		t.Error("the stream of another job has ended")
	default:
	}
	if ids, count := second.c.Deleted(before + 1); len(ids) != 0 || count != before+1 {
		t.Errorf("%v after the last of %d", ids, count)
	}
}
