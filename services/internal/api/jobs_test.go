package api_test

import (
	"encoding/json"
	"fmt"
	"math"
	"net/http"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
)

func TestSubmitAndGet(t *testing.T) {
	f := newFixture(t)
	body := fmt.Sprintf(`{"scene":"aa","entry":"s.xml","seed":%d,"stop":{"target_error":0.01}}`, uint64(math.MaxUint64))
	created := f.expect(201, "POST", "/v1/jobs", body)
	if got := created.header.Get("Location"); got != "/v1/jobs/j1" {
		t.Errorf("Location %q", got)
	}
	snapshot := decode[job.Snapshot](t, f.expect(200, "GET", "/v1/jobs/j1", ""))
	if snapshot.Request.Seed != math.MaxUint64 || snapshot.Request.Stop.TargetError != 0.01 {
		t.Errorf("request %+v lost precision", snapshot.Request)
	}
}

func TestSubmitRefusals(t *testing.T) {
	f := newFixture(t)
	cases := []struct {
		name, body string
		status     int
		location   string
	}{
		{"unknown field", `{"scene":"aa","entry":"s","sede":1}`, 422, "body.sede"},
		{"unknown stop rule", `{"scene":"aa","entry":"s","stop":{"target":1}}`, 422, "body.stop.target"},
		{"missing field", `{"scene":"aa"}`, 422, "body"},
		{"wrong type", `{"scene":"aa","entry":"s","seed":"x"}`, 422, "body.seed"},
		{"negative", `{"scene":"aa","entry":"s","seed":-1}`, 422, "body.seed"},
		{"integrator", `{"scene":"aa","entry":"s","integrator":"magic"}`, 422, "body.integrator"},
		{"target", `{"scene":"aa","entry":"s","stop":{"target_error":-1}}`, 422, "body.stop.target_error"},
		{"malformed", `{"scene":`, 400, ""},
		{"empty", ``, 400, ""},
		{"array", `[]`, 422, "body"},
		{"too large", `{"scene":"` + strings.Repeat("a", 5<<20) + `"}`, 413, ""},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			g := *f
			g.t = t
			g.expectProblem(c.status, c.location, g.do("POST", "/v1/jobs", c.body))
		})
	}
	if list := f.expect(200, "GET", "/v1/jobs", ""); !strings.Contains(string(list.body), `"jobs":[]`) {
		t.Errorf("a refused job was kept: %s", list.body)
	}
}

func TestIdempotencyKey(t *testing.T) {
	f := newFixture(t)
	first := decode[job.Snapshot](t, f.expect(201, "POST", "/v1/jobs", request, "Idempotency-Key", "k"))
	again := decode[job.Snapshot](t, f.expect(201, "POST", "/v1/jobs", request, "Idempotency-Key", "k"))
	if first.ID != again.ID {
		t.Errorf("jobs %s and %s under one key", first.ID, again.ID)
	}
	other := f.do("POST", "/v1/jobs", `{"scene":"bb","entry":"scene.xml"}`, "Idempotency-Key", "k")
	f.expectProblem(409, "", other)
}

func TestListPages(t *testing.T) {
	f := newFixture(t)
	for range 5 {
		f.submit()
	}
	var ids []string
	cursor := ""
	for pages := 0; ; pages++ {
		page := decode[struct {
			Jobs []job.Snapshot
			Next string
		}](t, f.expect(200, "GET", "/v1/jobs?limit=2&cursor="+cursor, ""))
		for _, snapshot := range page.Jobs {
			ids = append(ids, snapshot.ID)
		}
		if cursor = page.Next; cursor == "" {
			if pages != 2 {
				t.Errorf("%d pages, want 3", pages+1)
			}
			break
		}
	}
	if got := strings.Join(ids, " "); got != "j5 j4 j3 j2 j1" {
		t.Errorf("jobs %s", got)
	}
	f.expectProblem(422, "query.limit", f.do("GET", "/v1/jobs?limit=0", ""))
	f.expectProblem(422, "query.limti", f.do("GET", "/v1/jobs?limti=3", ""))
}

func TestActions(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	if s := decode[job.Snapshot](t, f.expect(200, "POST", "/v1/jobs/"+id+"/pause", "")); !s.Paused {
		t.Error("not paused")
	}
	if s := decode[job.Snapshot](t, f.expect(200, "POST", "/v1/jobs/"+id+"/resume", "")); s.Paused {
		t.Error("still paused")
	}
	f.expectProblem(409, "", f.do("DELETE", "/v1/jobs/"+id, ""))
	if s := decode[job.Snapshot](t, f.expect(200, "POST", "/v1/jobs/"+id+"/finish", "")); s.State != job.Done {
		t.Errorf("state %s", s.State)
	}
	f.expectProblem(409, "", f.do("POST", "/v1/jobs/"+id+"/cancel", ""))
	f.expect(204, "DELETE", "/v1/jobs/"+id, "")
	f.expectProblem(404, "", f.do("GET", "/v1/jobs/"+id, ""))
	second := f.submit()
	if s := decode[job.Snapshot](t, f.expect(200, "POST", "/v1/jobs/"+second+"/cancel", "")); s.State != job.Canceled {
		t.Errorf("state %s", s.State)
	}
}

func TestEveryJobRouteAnswers404ForUnknownJobs(t *testing.T) {
	f := newFixture(t)
	for _, route := range []string{
		"GET ", "DELETE ", "POST /cancel", "POST /pause", "POST /resume", "POST /finish", "GET /events",
		"GET /convergence", "GET /plan", "GET /anomalies", "GET /log", "GET /image.exr", "GET /image.png",
	} {
		method, path, _ := strings.Cut(route, " ")
		f.expectProblem(404, "", f.do(method, "/v1/jobs/nope"+path, ""))
	}
}

func TestUnmatchedRoutes(t *testing.T) {
	f := newFixture(t)
	f.expectProblem(404, "", f.do("GET", "/v1/nothing", ""))
	f.expectProblem(404, "", f.do("GET", "/nothing", ""))
	wrong := f.do("PUT", "/v1/jobs", "")
	f.expectProblem(405, "", wrong)
	if allow := strings.Join(wrong.header.Values("Allow"), " "); allow != "GET POST" {
		t.Errorf("Allow %q", allow)
	}
}

func TestForeignOriginsAndHostsAreRefused(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	f.expectProblem(403, "", f.do("POST", "/v1/jobs/"+id+"/cancel", "", "Sec-Fetch-Site", "cross-site"))
	f.expectProblem(http.StatusMisdirectedRequest, "", f.do("GET", "/v1/jobs", "", "Host", "evil.example"))
	f.expect(200, "GET", "/v1/jobs", "", "Host", "localhost:8080")
}

func TestOpenAPIDescribesAllRoutes(t *testing.T) {
	f := newFixture(t)
	var document struct {
		OpenAPI string
		Paths   map[string]map[string]json.RawMessage
	}
	if err := json.Unmarshal(f.expect(200, "GET", "/openapi.json", "").body, &document); err != nil {
		t.Fatal(err)
	}
	if !strings.HasPrefix(document.OpenAPI, "3.1") {
		t.Errorf("version %s", document.OpenAPI)
	}
	for _, route := range []string{
		"post /v1/scenes", "get /v1/scenes/{sha256}", "post /v1/jobs", "get /v1/jobs", "get /v1/jobs/{id}",
		"delete /v1/jobs/{id}", "post /v1/jobs/{id}/cancel", "post /v1/jobs/{id}/pause",
		"post /v1/jobs/{id}/resume", "post /v1/jobs/{id}/finish", "get /v1/jobs/{id}/events",
		"get /v1/jobs/{id}/convergence", "get /v1/jobs/{id}/plan", "get /v1/jobs/{id}/anomalies",
		"get /v1/jobs/{id}/log", "get /v1/jobs/{id}/image.exr", "get /v1/jobs/{id}/image.png",
		"get /v1/workers", "post /v1/workers/{id}/drain", "get /v1/autoscale", "get /healthz", "get /readyz",
	} {
		method, path, _ := strings.Cut(route, " ")
		if document.Paths[path][method] == nil {
			t.Errorf("%s is not described", route)
		}
	}
}

func TestPagesLoadNothingFromElsewhere(t *testing.T) {
	f := newFixture(t)
	for _, path := range []string{"/", "/docs"} {
		page := f.expect(200, "GET", path, "")
		for _, sign := range []string{`src="http`, `href="http`, `src="//`, `href="//`, "@import", "<style", "onclick="} {
			if strings.Contains(string(page.body), sign) {
				t.Errorf("%s contains %s", path, sign)
			}
		}
		policy := page.header.Get("Content-Security-Policy")
		if !strings.HasPrefix(policy, "default-src 'none'") || strings.Contains(policy, "unsafe") {
			t.Errorf("%s has the policy %q", path, policy)
		}
	}
}
