package client_test

import (
	"bytes"
	"errors"
	"net/http"
	"net/http/httptest"
	"strings"
	"testing"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/client"
	"metrofarm/services/internal/fakefarm"
	"metrofarm/services/internal/job"
)

// connect starts the real REST interface over a fake farm.
func connect(t *testing.T) (*fakefarm.Farm, *client.Client) {
	t.Helper()
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	farm := fakefarm.New(nil)
	handler, err := api.NewHandler(api.Options{
		Service: farm, Scenes: bundle.NewLibrary(blob.New(backend), bundle.DefaultLimits(), t.TempDir()),
	})
	if err != nil {
		t.Fatal(err)
	}
	server := httptest.NewServer(handler)
	t.Cleanup(server.Close)
	c, err := client.New(server.URL, client.Options{})
	if err != nil {
		t.Fatal(err)
	}
	return farm, c
}

func TestJobLife(t *testing.T) {
	farm, c := connect(t)
	ctx := t.Context()
	for range 3 {
		if _, err := c.Submit(ctx, job.Request{Scene: "aa", Entry: "s.xml", Seed: 7}, ""); err != nil {
			t.Fatal(err)
		}
	}
	jobs, err := c.Jobs(ctx, 2)
	if err != nil || len(jobs) != 2 || jobs[0].ID != "j3" {
		t.Errorf("jobs %+v, error %v", jobs, err)
	}
	if jobs, err = c.Jobs(ctx, 0); err != nil || len(jobs) != 3 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
	image := job.Image{Width: 1, Height: 1, RGB: make([]float32, 3), Variance: make([]float32, 3)}
	farm.CompleteRound("j1", job.ConvergencePoint{FilmSHA256: "f"}, image, func(*job.Snapshot) {})
	var png bytes.Buffer
	if err := c.Download(ctx, "j1", "image.png", &png); err != nil || !strings.HasPrefix(png.String(), "\x89PNG") {
		t.Errorf("PNG of %d bytes, error %v", png.Len(), err)
	}
	if s, err := c.Finish(ctx, "j1"); err != nil || s.State != job.Done {
		t.Errorf("%+v, error %v", s, err)
	}
	if _, err := c.Cancel(ctx, "j1"); !errors.Is(err, job.ErrConflict) {
		t.Errorf("error %v, want ErrConflict", err)
	}
	if _, err := c.Job(ctx, "j9"); !errors.Is(err, job.ErrNotFound) || !strings.Contains(err.Error(), "j9") {
		t.Errorf("error %v, want ErrNotFound with the name", err)
	}
}

func TestProblemsNameTheField(t *testing.T) {
	_, c := connect(t)
	_, err := c.Submit(t.Context(), job.Request{Scene: "aa", Entry: "s", Integrator: "magic"}, "")
	if err == nil || !strings.Contains(err.Error(), "integrator") {
		t.Errorf("error %v", err)
	}
}

func TestEventsFollowAndResume(t *testing.T) {
	farm, c := connect(t)
	if _, err := c.Submit(t.Context(), job.Request{Scene: "aa", Entry: "s"}, ""); err != nil {
		t.Fatal(err)
	}
	_, events, err := c.Events(t.Context(), "j1", 0)
	if err != nil {
		t.Fatal(err)
	}
	if e := <-events; e.Sequence != 1 || e.Job == nil {
		t.Errorf("first event %+v", e)
	}
	farm.Update("j1", "progress", strings.Repeat("long ", 50_000), func(s *job.Snapshot) { s.Progress = 0.5 })
	if e := <-events; e.Sequence != 2 || e.Job.Progress != 0.5 {
		t.Errorf("second event %d", e.Sequence)
	}
	_, resumed, err := c.Events(t.Context(), "j1", 1)
	if err != nil {
		t.Fatal(err)
	}
	if e := <-resumed; e.Sequence != 2 {
		t.Errorf("resumed at %d, want 2", e.Sequence)
	}
	farm.DropWatchers("j1")
	if _, open := <-events; open {
		t.Error("the channel outlives the stream")
	}
}

func TestUploadAndWorkers(t *testing.T) {
	farm, c := connect(t)
	if _, err := c.Upload(t.Context(), strings.NewReader("no archive")); err == nil {
		t.Error("text was accepted as an archive")
	}
	farm.SetWorkers(job.Worker{ID: "w1", State: "idle"})
	if w, err := c.Drain(t.Context(), "w1"); err != nil || w.State != "draining" {
		t.Errorf("%+v, error %v", w, err)
	}
	if ws, err := c.Workers(t.Context()); err != nil || len(ws) != 1 {
		t.Errorf("%+v, error %v", ws, err)
	}
}

func TestForeignServers(t *testing.T) {
	for _, wrong := range []string{"", "localhost:8080", "ftp://x", "http://"} {
		if _, err := client.New(wrong, client.Options{}); err == nil {
			t.Errorf("%q was accepted", wrong)
		}
	}
	server := httptest.NewServer(http.NotFoundHandler())
	defer server.Close()
	c, err := client.New(server.URL, client.Options{})
	if err != nil {
		t.Fatal(err)
	}
	if _, err := c.Job(t.Context(), "x"); err == nil || !strings.Contains(err.Error(), "404") {
		t.Errorf("error %v", err)
	}
}
