package coordinator_test

import (
	"context"
	"errors"
	"slices"
	"strings"
	"testing"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/coordinator/fakeworker"
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

func inspectWith(t *testing.T, change func(*scenev1.SceneReport)) (*site, string, func()) {
	t.Helper()
	s := newSite(t)
	s.start()
	request := chainsRequest(20)
	request.InspectOnly = true
	id := s.submit(request)
	dismiss := s.crew(workers(3, func(w *fakeworker.Worker) {
		w.Report = report("pssmlt")
		change(w.Report)
	})...)
	return s, id, func() { dismiss(); s.stop() }
}

func TestWarningsOfTheSceneAreToldAndStoredOnce(t *testing.T) {
	s, id, done := inspectWith(t, func(r *scenev1.SceneReport) { r.Warnings = []string{"scene.xml:3: odd"} })
	defer done()
	end := s.await(id, "done", func(j job.Snapshot) bool { return j.State.Ended() })
	if !slices.Equal(end.Warnings, []string{"scene.xml:3: odd"}) {
		t.Errorf("warnings %q", end.Warnings)
	}
	records, err := s.db.Jobs(t.Context(), 0, 10)
	if err != nil || len(records) != 1 || len(records[0].Warnings) != 0 ||
		!strings.Contains(records[0].SceneReport, "odd") {
		t.Errorf("records %+v, error %v", records, err)
	}
}

func TestReportsThatNoWorkerMakesAreRefused(t *testing.T) {
	for name, change := range map[string]func(*scenev1.SceneReport){
		"too many warnings": func(r *scenev1.SceneReport) { r.Warnings = make([]string, 102) },
		"filter too wide":   func(r *scenev1.SceneReport) { r.FilterRadius = 19.5 },
		"filter negative":   func(r *scenev1.SceneReport) { r.FilterRadius = -1 },
	} {
		t.Run(name, func(t *testing.T) {
			s, id, done := inspectWith(t, change)
			defer done()
			if end := s.await(id, "failed", func(j job.Snapshot) bool { return j.State.Ended() }); end.State != job.Failed {
				t.Errorf("%s: %q", end.State, end.Error)
			}
		})
	}
}
