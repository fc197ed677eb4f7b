package peer

import (
	"bufio"
	"context"
	"crypto/rand"
	"encoding/json"
	"fmt"
	"io"
	"log/slog"
	"net/http"
	"net/http/httptest"
	"strings"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/client"
	"metrofarm/services/internal/fakefarm"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// member is a coordinator of a test's farm: it owns all the jobs in its fake.
type member struct {
	*fakefarm.Farm
	server *httptest.Server
	served atomic.Int32 // requests
	url    string       // that others are told
	secret string       // likewise
	other  *member
	own    []string // ids
}

// Owner sends what is not here to the other, as from a record in a store they share.
func (m *member) Owner(ctx context.Context, id string) (store.Member, error) {
	if _, err := m.Job(ctx, id); err == nil || m.other == nil {
		return store.Member{}, nil
	}
	return m.other.described(), nil
}

func (m *member) Peers(context.Context) ([]store.Member, error) {
	return []store.Member{m.other.described()}, nil
}

func (m *member) described() store.Member { return store.Member{REST: m.url, Secret: m.secret} }

func (m *member) Own() []job.Snapshot {
	var jobs []job.Snapshot
	for _, id := range m.own {
		if j, err := m.Job(context.Background(), id); err == nil {
			jobs = append(jobs, j)
		}
	}
	return jobs
}

// Jobs lists those of both, the other's as they were stored.
func (m *member) Jobs(_ context.Context, _ string, _ int) ([]job.Snapshot, string, error) {
	jobs := m.Own()
	for _, j := range m.other.Own() {
		jobs = append(jobs, job.Snapshot{ID: j.ID, State: job.Queued, Stale: true, Owner: m.other.url})
	}
	return jobs, "", nil
}

// newFarm starts two members; the first has a job.
func newFarm(t *testing.T) (owner, asked *member, id string) {
	t.Helper()
	return newFarmWith(t, func(*api.Options) {})
}

func newFarmWith(t *testing.T, change func(*api.Options)) (owner, asked *member, id string) {
	t.Helper()
	owner, asked = &member{Farm: fakefarm.New(nil)}, &member{Farm: fakefarm.New(nil)}
	owner.other, asked.other = asked, owner
	for _, m := range []*member{owner, asked} {
		m.secret = rand.Text()
		farm := New(m, Options{Logger: slog.New(slog.DiscardHandler), Secret: m.secret})
		options := api.Options{Service: farm, Forward: farm.Forward, Forwarded: farm.Forwarded}
		change(&options)
		handler, err := api.NewHandler(options)
		if err != nil {
			t.Fatal(err)
		}
		m.server = httptest.NewServer(http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
			m.served.Add(1)
			handler.ServeHTTP(w, r)
		}))
		m.url = m.server.URL
		t.Cleanup(m.server.Close)
		t.Cleanup(m.server.CloseClientConnections)
	}
	j, err := owner.Submit(t.Context(), job.Request{Scene: "s", Entry: "e"}, "")
	if err != nil {
		t.Fatal(err)
	}
	owner.own = []string{j.ID}
	return owner, asked, j.ID
}

func do(t *testing.T, method, url string, header map[string]string) (*http.Response, string) {
	t.Helper()
	request, err := http.NewRequestWithContext(t.Context(), method, url, nil)
	if err != nil {
		t.Fatal(err)
	}
	for name, value := range header {
		request.Header.Set(name, value)
	}
	response, err := http.DefaultClient.Do(request)
	if err != nil {
		t.Fatal(err)
	}
	defer response.Body.Close()
	body, err := io.ReadAll(response.Body)
	if err != nil {
		t.Fatal(err)
	}
	return response, string(body)
}

func TestRequestsGoToTheOwner(t *testing.T) {
	owner, asked, id := newFarm(t)
	response, body := do(t, http.MethodGet, asked.url+"/v1/jobs/"+id, nil)
	if response.StatusCode != http.StatusOK || !strings.Contains(body, id) {
		t.Errorf("%s: %s", response.Status, body)
	}
	if n := len(response.Header.Values("Content-Security-Policy")); n != 1 {
		t.Errorf("%d policies", n)
	}
	// From a page of the coordinator that was asked.
	sameOrigin := map[string]string{"Origin": asked.url}
	if response, body := do(t, http.MethodPost, asked.url+"/v1/jobs/"+id+"/pause", sameOrigin); response.StatusCode != http.StatusOK {
		t.Errorf("pause: %s: %s", response.Status, body)
	}
	if j, _ := owner.Job(t.Context(), id); !j.Paused {
		t.Error("the job was not paused")
	}
	foreign := map[string]string{"Origin": "http://elsewhere.example"}
	if response, _ := do(t, http.MethodPost, asked.url+"/v1/jobs/"+id+"/resume", foreign); response.StatusCode != http.StatusForbidden {
		t.Errorf("from a foreign page: %s", response.Status)
	}
	if response, _ := do(t, http.MethodGet, asked.url+"/v1/jobs/"+id+"/image.png", nil); response.StatusCode != http.StatusConflict {
		t.Errorf("image: %s", response.Status)
	}
}

func TestChangesGoToTheOwner(t *testing.T) {
	owner, asked, id := newFarm(t)
	c, err := client.New(asked.url, client.Options{})
	if err != nil {
		t.Fatal(err)
	}
	s, err := c.Change(t.Context(), id, map[string]any{"priority": 4, "name": "renamed"})
	if err != nil || s.Request.Priority != 4 {
		t.Errorf("%+v, error %v", s.Request, err)
	}
	if j, _ := owner.Job(t.Context(), id); j.Request.Priority != 4 || j.Request.Name != "renamed" {
		t.Errorf("the owner has %+v", j.Request)
	}
}

func TestNothingGoesRoundInCircles(t *testing.T) {
	owner, asked, _ := newFarm(t)
	response, body := do(t, http.MethodGet, asked.url+"/v1/jobs/unknown", nil) // each takes the other for its owner
	if response.StatusCode != http.StatusNotFound {
		t.Errorf("%s: %s", response.Status, body)
	}
	if n := owner.served.Load() + asked.served.Load(); n != 2 {
		t.Errorf("%d requests", n)
	}
}

func TestAnOwnerThatIsGone(t *testing.T) {
	owner, asked, id := newFarm(t)
	owner.server.Close()
	response, body := do(t, http.MethodGet, asked.url+"/v1/jobs/"+id, nil)
	if response.StatusCode != http.StatusServiceUnavailable || response.Header.Get("Retry-After") == "" {
		t.Errorf("%s: %s", response.Status, body)
	}
	if jobs := list(t, asked); len(jobs) != 1 || !jobs[0].Stale {
		t.Errorf("jobs %+v", jobs)
	}
}

func list(t *testing.T, m *member) []job.Snapshot {
	t.Helper()
	var answer struct{ Jobs []job.Snapshot }
	_, body := do(t, http.MethodGet, m.url+"/v1/jobs", nil)
	if err := json.Unmarshal([]byte(body), &answer); err != nil {
		t.Fatal(err)
	}
	return answer.Jobs
}

func TestListsShowTheJobsOfAll(t *testing.T) {
	owner, asked, id := newFarm(t)
	owner.Update(id, "state", "", func(j *job.Snapshot) { j.State, j.RoundsDone = job.Rendering, 5 })
	for i := range 2*pageLength + 5 { // more than one page
		j, err := owner.Submit(t.Context(), job.Request{Scene: "s", Entry: fmt.Sprint(i)}, "")
		if err != nil {
			t.Fatal(err)
		}
		owner.own = append([]string{j.ID}, owner.own...)
	}
	jobs := list(t, asked)
	if len(jobs) != len(owner.own) {
		t.Fatalf("%d jobs", len(jobs))
	}
	for _, j := range jobs {
		if j.Stale {
			t.Fatalf("%s is stale", j.ID)
		}
	}
	if last := jobs[len(jobs)-1]; last.ID != id || last.RoundsDone != 5 {
		t.Errorf("last %+v", last)
	}
}

func TestWorkersOfAllAreShownOnceAndDrained(t *testing.T) {
	owner, asked, _ := newFarm(t)
	owner.SetWorkers(job.Worker{ID: "w-1", Name: "a", State: "busy", LeasedSegments: 2}, job.Worker{ID: "w-2", Name: "b", State: "idle"})
	asked.SetWorkers(job.Worker{ID: "w-1", Name: "a", State: "idle", LeasedSegments: 1})
	var answer struct{ Workers []job.Worker }
	_, body := do(t, http.MethodGet, asked.url+"/v1/workers", nil)
	if err := json.Unmarshal([]byte(body), &answer); err != nil {
		t.Fatal(err)
	}
	if w := answer.Workers; len(w) != 2 || w[0].State != "busy" || w[0].LeasedSegments != 3 || w[1].ID != "w-2" {
		t.Errorf("workers %+v", w)
	}
	for _, id := range []string{"w-1", "w-2"} {
		if response, body := do(t, http.MethodPost, asked.url+"/v1/workers/"+id+"/drain", nil); response.StatusCode != http.StatusOK {
			t.Errorf("drain %s: %s %s", id, response.Status, body)
		}
	}
	for _, m := range []*member{owner, asked} {
		workers, _ := m.Workers(t.Context())
		for _, w := range workers {
			if w.State != "draining" {
				t.Errorf("worker %+v", w)
			}
		}
	}
	if response, _ := do(t, http.MethodPost, asked.url+"/v1/workers/none/drain", nil); response.StatusCode != http.StatusNotFound {
		t.Errorf("drain nobody: %s", response.Status)
	}
}

// follow reads events over the coordinator that does not own the job.
func follow(t *testing.T, asked *member, id, last string) (next func() (event, data string)) {
	t.Helper()
	ctx, cancel := context.WithTimeout(t.Context(), 30*time.Second)
	t.Cleanup(cancel)
	request, err := http.NewRequestWithContext(ctx, http.MethodGet, asked.url+"/v1/jobs/"+id+"/events", nil)
	if err != nil {
		t.Fatal(err)
	}
	if last != "" {
		request.Header.Set("Last-Event-ID", last)
	}
	response, err := http.DefaultClient.Do(request)
	if err != nil {
		t.Fatal(err)
	}
	t.Cleanup(func() { response.Body.Close() })
	lines := bufio.NewScanner(response.Body)
	return func() (number, data string) {
		for lines.Scan() {
			if text, ok := strings.CutPrefix(lines.Text(), "id: "); ok {
				number = text
			}
			if text, ok := strings.CutPrefix(lines.Text(), "data: "); ok {
				return number, text
			}
		}
		t.Fatalf("the stream ended: %v", lines.Err())
		return "", ""
	}
}

func TestEventsComeThroughAtOnce(t *testing.T) {
	owner, asked, id := newFarm(t)
	next := follow(t, asked, id, "")
	if number, data := next(); number != "1" || !strings.Contains(data, "queued") {
		t.Fatalf("event %s: %s", number, data)
	}
	owner.Update(id, "state", "live one", func(*job.Snapshot) {})
	if number, data := next(); number != "2" || !strings.Contains(data, "live one") {
		t.Fatalf("event %s: %s", number, data)
	}
	owner.Update(id, "state", "live two", func(*job.Snapshot) {})
	if number, data := follow(t, asked, id, "2")(); number != "3" || !strings.Contains(data, "live two") {
		t.Fatalf("after the second: event %s: %s", number, data)
	}
}

func TestLiveJobsAreThoseOfAll(t *testing.T) {
	owner, asked, id := newFarm(t)
	other, err := asked.Submit(t.Context(), job.Request{Scene: "s", Entry: "e"}, "")
	if err != nil {
		t.Fatal(err)
	}
	owner.Update(id, "progress", "", func(s *job.Snapshot) { s.Progress = 0.25 })
	asked.own = []string{other.ID}
	farm := New(asked, Options{Logger: slog.New(slog.DiscardHandler)})
	jobs, err := farm.Live(t.Context())
	if err != nil || len(jobs) != 2 || jobs[1].Progress != 0.25 {
		t.Errorf("%+v (%v)", jobs, err)
	}
	owner.server.Close()
	if jobs, err := farm.Live(t.Context()); err != nil || len(jobs) != 1 {
		t.Errorf("without the other: %+v (%v)", jobs, err)
	}
}
