package cli

import (
	"net/http/httptest"
	"strings"
	"testing"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/fakefarm"
	"metrofarm/services/internal/job"
)

func TestChangeAndList(t *testing.T) {
	farm := fakefarm.New(nil)
	handler, err := api.NewHandler(api.Options{Service: farm})
	if err != nil {
		t.Fatal(err)
	}
	server := httptest.NewServer(handler)
	defer server.Close()
	for range 2 {
		if _, err := farm.Submit(t.Context(), job.Request{Scene: "s", Entry: "e.xml"}, ""); err != nil {
			t.Fatal(err)
		}
	}
	farm.Update("j2", "state", "", func(s *job.Snapshot) { s.QueuePosition = 17 })
	b := newBench(t, listsScene)
	if code := b.run(t, "change", "j1", "j2", "--priority", "-3", "--name", "night", "--server", server.URL); code != 0 {
		t.Fatalf("exit code %d, %s", code, b.stderr.String())
	}
	if got := strings.Count(b.stdout.String(), "priority -3  night"); got != 2 {
		t.Errorf("printed %q", b.stdout.String())
	}
	b.stdout.Reset()
	if code := b.run(t, "jobs", "--server", server.URL); code != 0 {
		t.Fatalf("exit code %d, %s", code, b.stderr.String())
	}
	header, rows, _ := strings.Cut(b.stdout.String(), "\n")
	line, _, _ := strings.Cut(rows, "\n")
	if fields := strings.Fields(line); !strings.Contains(header, "PRIORITY") || !strings.Contains(header, "QUEUE") ||
		strings.Join(fields[:6], " ") != "j2 night - -3 queued 17" {
		t.Errorf("listed %s %q", header, line)
	}
}
