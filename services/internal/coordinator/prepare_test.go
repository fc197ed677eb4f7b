package coordinator_test

import (
	"strings"
	"testing"

	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// preparedRequest passes all stages between inspection and rendering.
func preparedRequest() job.Request {
	r := chainsRequest(20)
	r.Target, r.KernelTuning, r.DirectApart = "equalized", "on", "on"
	return r
}

func TestMapTrialsAndDirectLight(t *testing.T) {
	done := reference(t, preparedRequest())
	for _, part := range []string{`"targetMap"`, `"kernelTuning"`, `"directSizes"`} {
		if !strings.Contains(done.Resolved, part) {
			t.Errorf("%s is missing from %s", part, done.Resolved)
		}
	}
	// The fake worker's acceptance is 0.4 for radii of 0.015, which is half the default.
	if !strings.Contains(done.Resolved, "small steps of 0.5 times the kernel's size are accepted in 40 %") {
		t.Error(done.Resolved)
	}
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(3, nil)...)()
	sameFilm(t, s.finished(s.submit(preparedRequest())), done)
	repeat := preparedRequest()
	repeat.Resolved = done.Resolved
	again := s.finished(s.submit(repeat))
	sameFilm(t, again, done)
	if again.PathEvaluations >= done.PathEvaluations {
		t.Errorf("a repeated job evaluated %d paths, the first %d", again.PathEvaluations, done.PathEvaluations)
	}
}

func TestPreparationSurvivesTheCoordinator(t *testing.T) {
	want := reference(t, preparedRequest())
	s := newSite(t)
	s.start()
	defer s.crew(workers(2, nil)...)()
	id := s.submit(preparedRequest())
	s.await(id, "preparing", func(j job.Snapshot) bool {
		return j.State == job.Bootstrapping || j.State == job.Rendering || j.State.Ended()
	})
	s.kill()
	s.start()
	defer s.stop()
	sameFilm(t, s.finished(id), want)
}

// TestChainsKeepDirectLightWhereNothingElseIs: without seeds nobody would render a group's share of
// the direct light.
func TestChainsKeepDirectLightWhereNothingElseIs(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(1, func(w *fakeworker.Worker) { w.OneBounce = true })...)()
	request := chainsRequest(20)
	request.DirectApart = "on"
	done := s.finished(s.submit(request))
	if strings.Contains(done.Resolved, "directSizes") || done.RoundsDone == 0 {
		t.Errorf("%d rounds of %s", done.RoundsDone, done.Resolved)
	}
	if !strings.Contains(strings.Join(done.Warnings, "\n"), "direct light") {
		t.Error(done.Warnings)
	}
	plain := chainsRequest(20)
	sameFilm(t, s.finished(s.submit(plain)), done)
}
