package coordinator_test

import (
	"context"
	"errors"
	"fmt"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
)

func failing() fakeworker.Fault { return fakeworker.Failing }

// However many workers there are, a task that none of them can do ends its job, with the evidence.
func TestPoisonedTaskFailsTheJob(t *testing.T) {
	for n := 1; n <= 3; n++ {
		t.Run(fmt.Sprint(n, " workers"), func(t *testing.T) {
			t.Parallel()
			s := newSite(t)
			s.start()
			defer s.stop()
			defer s.crew(workers(n, func(w *fakeworker.Worker) { w.Fault = failing })...)()
			s.awaitWorkers(n)
			id := s.submit(chainsRequest(20))
			failed := s.await(id, "failed", func(j job.Snapshot) bool { return j.State.Ended() })
			if failed.State != job.Failed || strings.Count(failed.Error, "(w-") != n ||
				!strings.Contains(failed.Error, "it failed 3 time(s)") || !strings.Contains(failed.Error, "no such task") {
				t.Errorf("%s: %q", failed.State, failed.Error)
			}
		})
	}
}

// A task that failed once on each of two workers is offered again: nobody waits for a third.
func TestATaskThatBothWorkersFailedIsOfferedAgain(t *testing.T) {
	s := patientSite(t)
	a, b := newHand(t, s.c, "a"), newHand(t, s.c, "b")
	id := s.submit(pathRequest(1))
	a.fail(a.lease()[0])
	if again := a.lease(); len(again) != 0 {
		t.Fatalf("a gets %v again before b has tried", again)
	}
	b.fail(b.lease()[0])
	again := a.lease()
	if len(again) != 1 {
		t.Fatal("the task waits for a third worker")
	}
	if state := s.job(id).State; state.Ended() {
		t.Errorf("%s after one failure of each", state)
	}
	a.fail(again[0])
	if failed := s.job(id); failed.State != job.Failed || !strings.Contains(failed.Error, "it failed 3 time(s), on a (w-") {
		t.Errorf("%s: %q", failed.State, failed.Error)
	}
}

func TestWorkersOfAnotherVersionStayOut(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	crew := workers(1, nil)
	dismiss := s.crew(crew...)
	request := chainsRequest(0)
	request.Stop = job.StopRules{TimeSeconds: 3600}
	id := s.submit(request)
	s.await(id, "rendering", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	dismiss()
	time.Sleep(2 * testTTL) // its leases run out
	before := s.job(id).Mutations
	defer s.crew(workers(1, func(w *fakeworker.Worker) { w.Version, w.Name = "v2", "other" })...)()
	events, stream, err := s.c.Events(context.Background(), id, 0)
	if err != nil {
		t.Fatal(err)
	}
	warned := false
	for _, e := range events {
		warned = warned || e.Kind == "warning" && strings.Contains(e.Message, "v2")
	}
	for deadline := time.After(patience); !warned; {
		select {
		case e := <-stream:
			warned = e.Kind == "warning" && strings.Contains(e.Message, "v2")
		case <-deadline:
			t.Fatal("no warning about the version")
		}
	}
	if after := s.job(id).Mutations; after != before {
		t.Errorf("a worker of another version added %d mutations", after-before)
	}
}

func TestSubmitRefusals(t *testing.T) {
	ctx := context.Background()
	s := newSite(t)
	s.start()
	defer s.stop()
	bundle := s.bundle()
	good := job.Request{Scene: bundle, Entry: "scene.xml"}
	for field, change := range map[string]func(*job.Request){
		"scene":             func(r *job.Request) { r.Scene = strings.Repeat("0", 64) },
		"entry":             func(r *job.Request) { r.Entry = "other.xml" },
		"integrator":        func(r *job.Request) { r.Integrator = "magic" },
		"width":             func(r *job.Request) { r.Width = -1 },
		"sigma":             func(r *job.Request) { r.Kernel, r.Sigma = "gaussian", 0.25 },
		"stop.target_error": func(r *job.Request) { r.Stop.TargetError = -1 },
		"resolved":          func(r *job.Request) { r.Resolved = "{}" },
		"stop.mutations_per_pixel": func(r *job.Request) {
			r.Integrator, r.Stop.MutationsPerPixel = "path", 1
		},
	} {
		request := good
		change(&request)
		_, err := s.c.Submit(ctx, request, "")
		var wrong *job.FieldError
		if !errors.As(err, &wrong) || wrong.Field != field {
			t.Errorf("%s: %v", field, err)
		}
	}
}

func TestIdempotencyKey(t *testing.T) {
	ctx := context.Background()
	s := newSite(t)
	s.start()
	request := job.Request{Scene: s.bundle(), Entry: "scene.xml", Seed: 1}
	first, err := s.c.Submit(ctx, request, "key")
	if err != nil {
		t.Fatal(err)
	}
	s.kill()
	s.start()
	defer s.stop()
	if again, err := s.c.Submit(ctx, request, "key"); err != nil || again.ID != first.ID {
		t.Errorf("again: %s, %v; first: %s", again.ID, err, first.ID)
	}
	request.Seed = 2
	if _, err := s.c.Submit(ctx, request, "key"); !errors.Is(err, job.ErrConflict) {
		t.Errorf("reused: %v", err)
	}
	if jobs, next, err := s.c.Jobs(ctx, "", 10); err != nil || len(jobs) != 1 || next != "" {
		t.Errorf("%d jobs, next %q, error %v", len(jobs), next, err)
	}
}

func TestEventSequenceGoesOnAfterDeath(t *testing.T) {
	s := newSite(t)
	s.start()
	dismiss := s.crew(workers(2, nil)...)
	id := s.submit(chainsRequest(40))
	s.await(id, "in its second round", func(j job.Snapshot) bool { return j.RoundsDone >= 1 })
	before, _, err := s.c.Events(t.Context(), id, 0)
	if err != nil {
		t.Fatal(err)
	}
	last := before[len(before)-1].Sequence
	s.kill()
	s.start()
	s.finished(id)
	after, _, err := s.c.Events(t.Context(), id, last)
	if err != nil || len(after) == 0 {
		t.Fatalf("%d events after %d, error %v", len(after), last, err)
	}
	if final := after[len(after)-1]; final.Job == nil || final.Job.State != job.Done {
		t.Errorf("the last event is %+v", final)
	}
	for i, e := range after {
		if e.Sequence <= last || i > 0 && e.Sequence <= after[i-1].Sequence {
			t.Errorf("sequence %d after %d", e.Sequence, last)
		}
	}
	dismiss()
	s.stop()
}
