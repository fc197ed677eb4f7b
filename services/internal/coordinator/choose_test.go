package coordinator_test

import (
	"math"
	"strings"
	"testing"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

// open is a request that leaves the integrator open.
func open() job.Request {
	r := pathRequest(16)
	r.Integrator = ""
	return r
}

// inPathScene gives workers a scene whose file names plain path tracing.
func inPathScene(w *fakeworker.Worker) { w.Report = report("path") }

func TestAutoTakesPathsForEvenLight(t *testing.T) {
	want := reference(t, pathRequest(16))
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, inPathScene)...)()
	got := s.finished(s.submit(open()))
	sameFilm(t, got, want)
	if got.Integrator != "path" || got.Seed != 7 || !strings.Contains(got.Resolved, "autoDecision") {
		t.Errorf("%s with seed %d: %s", got.Integrator, got.Seed, got.Resolved)
	}
	if extra := got.PathEvaluations - want.PathEvaluations; extra != 2*16384 {
		t.Errorf("the pilot took %d samples", extra)
	}
	repeat := open()
	repeat.Resolved = got.Resolved
	again := s.finished(s.submit(repeat))
	sameFilm(t, again, want)
	if again.PathEvaluations != again.Mutations {
		t.Errorf("a repeated job took %d samples beside those of its image", again.PathEvaluations-again.Mutations)
	}
}

func TestAutoTakesChainsForSparks(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, func(w *fakeworker.Worker) { inPathScene(w); w.Sparks = true })...)()
	request := open()
	request.Chains, request.BootstrapSamples = 1024, 4096
	first := s.finished(s.submit(request))
	if first.Integrator != "pssmlt" || first.RoundsDone == 0 {
		t.Fatalf("%s, %d rounds", first.Integrator, first.RoundsDone)
	}
	sameFilm(t, s.finished(s.submit(request)), first)
}

func TestAutoSurvivesTheCoordinator(t *testing.T) {
	want := reference(t, pathRequest(16))
	s := newSite(t)
	s.start()
	defer s.crew(workers(2, inPathScene)...)()
	id := s.submit(open())
	s.await(id, "measured", func(j job.Snapshot) bool {
		return j.State == job.Bootstrapping || j.State == job.Rendering || j.State.Ended()
	})
	s.kill()
	s.start()
	defer s.stop()
	sameFilm(t, s.finished(id), want)
}

func multiplexedRequest() job.Request {
	r := chainsRequest(20)
	depth := 4
	r.Integrator, r.MaxDepth, r.DelayedRejection = "mmlt", &depth, "on"
	return r
}

func TestMultiplexedJobsTellOfTheirLengths(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, func(w *fakeworker.Worker) {
		w.Report.Structure = &scenev1.Structure{Shapes: 1, ExtendedLights: 1}
	})...)()
	done := s.finished(s.submit(multiplexedRequest()))
	if done.Integrator != "mmlt" || len(done.Lengths) != 4 {
		t.Fatalf("%s, lengths %+v", done.Integrator, done.Lengths)
	}
	b, probability, want := 0.0, 0.0, 0.0
	for i := range uint64(4096) {
		want += float64(fakeworker.BootstrapValue(7, i)) / 4096
	}
	for _, l := range done.Lengths {
		b, probability = b+*l.B, probability+*l.Probability
		if *l.BStandardError <= 0 || *l.BStandardError > *l.B || *l.Probability < 0.025 {
			t.Errorf("%+v", l)
		}
	}
	if math.Abs(b-want) > 1e-9 || math.Abs(probability-1) > 1e-9 {
		t.Errorf("b of all lengths %v, of all samples %v; probabilities sum to %v", b, want, probability)
	}
	if first := done.Lengths[0]; *first.Proposed < 0.74 || *first.Proposed > 0.76 || done.Lengths[3].Acceptance != nil {
		t.Errorf("shares %+v", done.Lengths)
	}
	repeat := multiplexedRequest()
	repeat.Resolved = done.Resolved
	sameFilm(t, s.finished(s.submit(repeat)), done)
}

func TestSecondStagesAreTold(t *testing.T) {
	done := reference(t, multiplexedRequest())
	second := done.Acceptance.Second
	if second == nil || *second < 0.24 || *second > 0.26 || done.Acceptance.SecondAfterLarge != nil || done.CoordinatesPerMutation != 10 {
		t.Errorf("acceptance %+v, %v coordinates", done.Acceptance, done.CoordinatesPerMutation)
	}
	if plain := reference(t, chainsRequest(20)); plain.Acceptance.Second != nil || plain.Lengths != nil {
		t.Errorf("acceptance %+v, lengths %v", plain.Acceptance, plain.Lengths)
	}
}
