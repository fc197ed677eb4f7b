package api_test

import (
	"encoding/json"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
)

const mergePatch = "application/merge-patch+json"

func TestChange(t *testing.T) {
	f := newFixture(t)
	created := decode[job.Snapshot](t, f.expect(201, "POST", "/v1/jobs", `{"scene":"aa","entry":"dir/scene.xml","priority":-5}`))
	if created.Request.Priority != -5 {
		t.Errorf("submitted with priority %d", created.Request.Priority)
	}
	cases := []struct {
		patch    string
		priority int
		name     string
	}{
		{`{"priority":7,"name":"first"}`, 7, "first"},
		{`{}`, 7, "first"},
		{`{"name":"second"}`, 7, "second"},
		{`{"priority":null}`, 0, "second"},
		{`{"priority":-100,"name":null}`, -100, "scene.xml"},
		{`{"name":""}`, -100, "scene.xml"},
	}
	for _, kind := range []string{mergePatch, "application/json"} {
		for _, c := range cases {
			s := decode[job.Snapshot](t, f.expect(200, "PATCH", "/v1/jobs/"+created.ID, c.patch, "Content-Type", kind))
			stored := decode[job.Snapshot](t, f.expect(200, "GET", "/v1/jobs/"+created.ID, ""))
			for _, r := range []job.Request{s.Request, stored.Request} {
				if r.Priority != c.priority || r.Name != c.name {
					t.Errorf("%s: priority %d, name %q", c.patch, r.Priority, r.Name)
				}
			}
		}
	}
	f.expect(200, "POST", "/v1/jobs/"+created.ID+"/cancel", "")
	f.expectProblem(409, "", f.do("PATCH", "/v1/jobs/"+created.ID, `{"priority":1}`, "Content-Type", mergePatch))
	f.expectProblem(404, "", f.do("PATCH", "/v1/jobs/none", `{"priority":1}`, "Content-Type", mergePatch))
}

func TestChangeRefusals(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	for _, c := range []struct {
		patch    string
		status   int
		location string
	}{
		{`{"priority":101}`, 422, "body.priority"},
		{`{"priority":-101}`, 422, "body.priority"},
		{`{"priority":1.5}`, 422, "body.priority"},
		{`{"priority":"9"}`, 422, "body.priority"},
		{`{"name":3}`, 422, "body.name"},
		{`{"name":"` + strings.Repeat("x", 201) + `"}`, 422, "body.name"},
		{`{"name":"new","seed":3}`, 422, "body.seed"},
		{`{"scene":null}`, 422, "body.scene"},
		{`{"prority":1}`, 422, "body.prority"},
		{`[]`, 422, "body"},
		{`null`, 422, "body"},
		{`{"priority":`, 400, ""},
		{``, 400, ""},
	} {
		t.Run(c.patch, func(t *testing.T) {
			g := *f
			g.t = t
			g.expectProblem(c.status, c.location, g.do("PATCH", "/v1/jobs/"+id, c.patch, "Content-Type", mergePatch))
		})
	}
	if s := decode[job.Snapshot](t, f.expect(200, "GET", "/v1/jobs/"+id, "")); s.Request.Name != "" || s.Request.Priority != 0 {
		t.Errorf("a refused change was made: %+v", s.Request)
	}
}

func TestPriorityIsNoPartOfTheIdempotencyKey(t *testing.T) {
	f := newFixture(t)
	first := decode[job.Snapshot](t, f.expect(201, "POST", "/v1/jobs", request, "Idempotency-Key", "k"))
	f.expect(200, "PATCH", "/v1/jobs/"+first.ID, `{"priority":3,"name":"renamed"}`)
	var withPriority map[string]any
	if err := json.Unmarshal([]byte(request), &withPriority); err != nil {
		t.Fatal(err)
	}
	withPriority["priority"] = 9
	body, err := json.Marshal(withPriority)
	if err != nil {
		t.Fatal(err)
	}
	for _, again := range []string{request, string(body)} {
		s := decode[job.Snapshot](t, f.expect(201, "POST", "/v1/jobs", again, "Idempotency-Key", "k"))
		if s.ID != first.ID || s.Request.Priority != 3 || s.Request.Name != "renamed" {
			t.Errorf("%s: job %s, %+v", again, s.ID, s.Request)
		}
	}
	f.expectProblem(422, "body.priority", f.do("POST", "/v1/jobs", `{"scene":"aa","entry":"s","priority":500}`))
}
