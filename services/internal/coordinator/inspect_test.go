package coordinator_test

import (
	"context"
	"errors"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
)

func TestAJobThatOnlyInspects(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	request := chainsRequest(20)
	request.InspectOnly = true
	id := s.submit(request)
	if _, err := s.c.SceneReport(context.Background(), id); !errors.Is(err, job.ErrNoReport) {
		t.Errorf("before a worker has looked: %v", err)
	}
	defer s.crew(workers(1, nil)...)()
	done := s.await(id, "done", func(j job.Snapshot) bool { return j.State.Ended() })
	if done.State != job.Done || done.RoundsDone != 0 {
		t.Errorf("%s after %d rounds", done.State, done.RoundsDone)
	}
	if _, err := s.c.Image(context.Background(), id); !errors.Is(err, job.ErrNoImage) {
		t.Errorf("image: %v", err)
	}
	report, err := s.c.SceneReport(context.Background(), id)
	if err != nil || !strings.Contains(report, `"width"`) {
		t.Errorf("report %q, error %v", report, err)
	}
}

func TestTheReportOutlivesTheCoordinator(t *testing.T) {
	s := newSite(t)
	s.start()
	request := chainsRequest(20)
	request.InspectOnly = true
	id := s.submit(request)
	dismiss := s.crew(workers(1, nil)...)
	s.await(id, "done", func(j job.Snapshot) bool { return j.State.Ended() })
	before, err := s.c.SceneReport(context.Background(), id)
	if err != nil {
		t.Fatal(err)
	}
	dismiss()
	s.stop()
	s.start()
	defer s.stop()
	if after, err := s.c.SceneReport(context.Background(), id); err != nil || after != before {
		t.Errorf("report %q, error %v; want %q", after, err, before)
	}
}
