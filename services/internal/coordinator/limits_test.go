package coordinator_test

import (
	"context"
	"errors"
	"os"
	"path/filepath"
	"strings"
	"testing"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/coordinator/fakeworker"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
)

func TestJobsThatAskForTooMuchAreRefused(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.Limits = plan.Limits{Pixels: 70*41 - 1, PerPixel: 100} }
	s.start()
	defer s.stop()
	defer s.crew(workers(1, nil)...)()
	request := chainsRequest(101)
	request.Scene, request.Entry = s.bundle(), "scene.xml"
	var field *job.FieldError
	if _, err := s.c.Submit(context.Background(), request, ""); !errors.As(err, &field) || field.Field != "stop.mutations_per_pixel" {
		t.Errorf("too many mutations: %v", err)
	}
	for _, integrator := range []string{"pssmlt", "auto"} { // what the scene asks for is known later
		id := s.submit(job.Request{Integrator: integrator, Stop: job.StopRules{Rounds: 1}})
		failed := s.await(id, "ended", func(j job.Snapshot) bool { return j.State.Ended() })
		if failed.State != job.Failed || !strings.Contains(failed.Error, "width: asks for 2870 pixels; this server takes at most 2869") {
			t.Errorf("%s: %s %q", integrator, failed.State, failed.Error)
		}
	}
	small := chainsRequest(1)
	small.Width, small.Height = 40, 40
	s.finished(s.submit(small))
}

// TestAnEstimateThatIsNoNumberFailsItsJob: squares that overflow make the error of b infinite.
func TestAnEstimateThatIsNoNumberFailsItsJob(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	dismiss := s.crew(workers(1, func(w *fakeworker.Worker) { w.Glare = 1e153 })...)
	id := s.submit(chainsRequest(100))
	failed := s.await(id, "ended", func(j job.Snapshot) bool { return j.State.Ended() })
	if failed.State != job.Failed || !strings.Contains(failed.Error, "b_standard_error is +Inf after round") {
		t.Errorf("%s after %d rounds: %q", failed.State, failed.RoundsDone, failed.Error)
	}
	dismiss()
	defer s.crew(workers(1, nil)...)()
	s.finished(s.submit(chainsRequest(1))) // the coordinator is well
}

func TestJobsRememberTheirUser(t *testing.T) {
	token, line, err := auth.NewToken(auth.Submit, "alice")
	if err != nil {
		t.Fatal(err)
	}
	path := filepath.Join(t.TempDir(), "tokens")
	if err := os.WriteFile(path, []byte(line), 0o600); err != nil {
		t.Fatal(err)
	}
	tokens, err := auth.OpenTokens(path)
	if err != nil {
		t.Fatal(err)
	}
	alice, _ := tokens.Find(token)
	s := newSite(t)
	s.start()
	request := chainsRequest(1)
	request.Scene, request.Entry = s.bundle(), "scene.xml"
	submitted, err := s.c.Submit(auth.With(context.Background(), alice), request, "")
	if err != nil || submitted.User != "alice" {
		t.Fatalf("user %q, error %v", submitted.User, err)
	}
	s.kill()
	s.start()
	defer s.stop()
	if after := s.job(submitted.ID); after.User != "alice" {
		t.Errorf("user %q after a restart", after.User)
	}
	defer s.crew(workers(1, nil)...)()
	if ended := s.finished(submitted.ID); ended.User != "alice" {
		t.Errorf("user %q at the end", ended.User)
	}
}
