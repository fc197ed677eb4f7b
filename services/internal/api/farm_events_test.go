package api_test

import (
	"encoding/json"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/job"
)

// farmMessage is what a client reads of the farm's stream.
type farmMessage struct {
	ID      string
	Full    bool
	Jobs    []job.Snapshot
	Workers []job.Worker
	Gone    []string
}

// farmMessage reads the stream until there is a message for which done holds.
func (f *fixture) farmMessage(lastID string, done func(farmMessage) bool) farmMessage {
	f.t.Helper()
	deadline := time.Now().Add(20 * time.Second)
	for time.Now().Before(deadline) {
		text := f.readEvents("/v1/events", "data: ", "Last-Event-ID", lastID)
		var m farmMessage
		for line := range strings.Lines(text) {
			if data, found := strings.CutPrefix(line, "data: "); found {
				if err := json.Unmarshal([]byte(data), &m); err != nil {
					f.t.Fatal(err)
				}
			}
			if id, found := strings.CutPrefix(line, "id: "); found {
				m.ID = strings.TrimSpace(id)
			}
		}
		if done(m) {
			return m
		}
		lastID = m.ID
	}
	f.t.Fatal("no such message")
	return farmMessage{}
}

func any1(farmMessage) bool { return true }

func TestFarmStreamTellsWhatChanged(t *testing.T) {
	f := newFixture(t)
	first, second, ended := f.submit(), f.submit(), f.submit()
	f.farm.Update(ended, "state", "", func(s *job.Snapshot) { s.State = job.Done })
	f.farm.Update(first, "progress", "", func(s *job.Snapshot) { s.Resolved, s.Lengths = "{}", []job.Length{{Edges: 1}} })
	f.farm.SetWorkers(job.Worker{ID: "w1", State: "busy"}, job.Worker{ID: "w2", State: "idle"})
	all := f.farmMessage("", any1)
	if !all.Full || len(all.Jobs) != 2 || len(all.Workers) != 2 || len(all.Gone) != 0 {
		t.Fatalf("the first message: %+v", all)
	}
	for _, j := range all.Jobs {
		if j.Resolved != "" || j.Lengths != nil {
			t.Errorf("%s is not brief", j.ID)
		}
	}
	f.farm.Update(second, "progress", "", func(s *job.Snapshot) { s.Progress = 0.5 })
	change := f.farmMessage(all.ID, any1)
	if change.Full || len(change.Jobs) != 1 || change.Jobs[0].ID != second || change.Jobs[0].Progress != 0.5 || len(change.Workers) != 0 {
		t.Errorf("after a change: %+v", change)
	}
	f.farm.Update(first, "state", "", func(s *job.Snapshot) { s.State = job.Done })
	f.farm.SetWorkers(job.Worker{ID: "w1", State: "busy"})
	last := f.farmMessage(change.ID, any1)
	if last.Full || len(last.Jobs) != 1 || last.Jobs[0].State != job.Done || len(last.Gone) != 1 || last.Gone[0] != "w2" {
		t.Errorf("after the end of %s: %+v", first, last)
	}
	if again := f.farmMessage(all.ID, any1); again.Full || len(again.Jobs) != 2 || len(again.Gone) != 1 {
		t.Errorf("who went on from the first message: %+v", again)
	}
}

func TestFarmStreamTellsOfDeletedJobs(t *testing.T) {
	f := newFixture(t)
	before := f.submit()
	f.expect(200, "POST", "/v1/jobs/"+before+"/cancel", "")
	f.expect(204, "DELETE", "/v1/jobs/"+before, "")
	told, listed := f.submit(), f.submit()
	f.farm.Update(listed, "state", "", func(s *job.Snapshot) { s.State = job.Done }) // no stream has told of it
	all := f.farmMessage("", any1)
	if len(all.Jobs) != 1 || len(all.Gone) != 0 {
		t.Errorf("the first message: %+v", all)
	}
	f.farm.Update(told, "state", "", func(s *job.Snapshot) { s.State = job.Done })
	ended := f.farmMessage(all.ID, any1)
	for _, id := range []string{told, listed} {
		f.expect(204, "DELETE", "/v1/jobs/"+id, "")
	}
	gone := make(map[string]bool)
	f.farmMessage(ended.ID, func(m farmMessage) bool {
		for _, id := range m.Gone {
			gone[id] = true
		}
		return gone[told] && gone[listed]
	})
	if len(gone) != 2 {
		t.Errorf("gone %v", gone)
	}
}

func TestFarmStreamOfAnotherProcessBeginsAnew(t *testing.T) {
	f := newFixture(t)
	f.submit()
	for _, id := range []string{"other-1", "x", "-", strings.Split(f.farmMessage("", any1).ID, "-")[0] + "-999999999"} {
		if m := f.farmMessage(id, any1); !m.Full || len(m.Jobs) != 1 {
			t.Errorf("after %s: %+v", id, m)
		}
	}
}

func TestAQuietFarmStreamStaysOpen(t *testing.T) {
	f := newFixture(t)
	if text := f.readEvents("/v1/events", ":"); !strings.Contains(text, `"full":true`) || strings.Contains(text, "(end)") {
		t.Errorf("%s", text)
	}
}

func TestBriefLists(t *testing.T) {
	f := newFixture(t)
	f.farm.Update(f.submit(), "progress", "", func(s *job.Snapshot) { s.Resolved = "{}" })
	for view, want := range map[string]int{"": 1, "?view=full": 1, "?view=brief": 0} {
		if got := strings.Count(string(f.expect(200, "GET", "/v1/jobs"+view, "").body), `"resolved"`); got != want {
			t.Errorf("%q: %d resolved, want %d", view, got, want)
		}
	}
	f.expectProblem(422, "query.view", f.do("GET", "/v1/jobs?view=short", ""))
}
