package coordinator_test

import (
	"context"
	"strings"
	"testing"

	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// trappedWarnings of a job, and its warning events.
func trappedWarnings(t *testing.T, s *site, done job.Snapshot) (warnings, events int) {
	t.Helper()
	for _, text := range done.Warnings {
		if strings.Contains(text, "do not move for 2000") {
			warnings++
		}
	}
	past, _, err := s.c.Events(context.Background(), done.ID, 0)
	s.check(err)
	for _, e := range past {
		if e.Kind == "warning" && strings.Contains(e.Message, "do not move for 2000") {
			events++
		}
	}
	return warnings, events
}

func TestTrappedChainsAreTold(t *testing.T) {
	for _, trapped := range []bool{true, false} {
		s := newSite(t)
		s.start()
		dismiss := s.crew(workers(2, func(w *fakeworker.Worker) { w.Trapped = trapped })...)
		done := s.finished(s.submit(chainsRequest(60)))
		warnings, events := trappedWarnings(t, s, done)
		if trapped && (done.LongestStay != 4500 || done.TrappedChains != 1 || warnings != 1 || events != 1) {
			t.Errorf("longest stay %d, %d trapped, %d warnings, %d events", done.LongestStay, done.TrappedChains, warnings, events)
		}
		if !trapped && (done.LongestStay != 0 || done.TrappedChains != 0 || warnings != 0 || events != 0) {
			t.Errorf("none trapped: longest stay %d, %d trapped, %d warnings, %d events", done.LongestStay, done.TrappedChains, warnings, events)
		}
		if done.RoundsDone < 2 || done.EffectiveSamples <= 0 {
			t.Errorf("%d rounds, %v effective samples", done.RoundsDone, done.EffectiveSamples)
		}
		dismiss()
		s.stop()
	}
}

func TestLayersOfTheImage(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, nil)...)()
	request := multiplexedRequest()
	request.Layers = []string{job.LayerTechniques, job.LayerAcceptance}
	done := s.finished(s.submit(request))
	image, err := s.c.Image(context.Background(), done.ID)
	s.check(err)
	var names []string
	for _, layer := range image.Layers {
		names = append(names, layer.Name)
	}
	if got := strings.Join(names, " "); got != "acceptance technique.s0 technique.s1 technique.s2 technique.s3 technique.s4" {
		t.Errorf("layers %s", got)
	}
	repeat := multiplexedRequest()
	repeat.Resolved = done.Resolved
	sameFilm(t, s.finished(s.submit(repeat)), done)
}
