package api_test

import (
	"encoding/json"
	"strings"
	"testing"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

const threeFrames = `{"job":{"scene":"aa","entry":"scene.xml","seed":7},"frames":{"start":1,"end":5,"step":2,"fps":10,"seeds":"per-frame"}}`

func (f *fixture) submitFrames() job.Sequence {
	f.t.Helper()
	return decode[job.Sequence](f.t, f.expect(201, "POST", "/v1/sequences", threeFrames))
}

func TestASequenceFromSubmissionToDeletion(t *testing.T) {
	f := newFixture(t)
	created := f.expect(201, "POST", "/v1/sequences", threeFrames)
	q := decode[job.Sequence](t, created)
	if created.header.Get("Location") != "/v1/sequences/"+q.ID || q.State != job.Queued || q.States[job.Queued] != 3 || len(q.Frames) != 3 {
		t.Fatalf("%s: %+v", created.header.Get("Location"), q)
	}
	frame := q.Frames[1]
	if frame.Number != 3 || frame.Seed != 10 || frame.ShutterOpen != 0.275 || frame.ShutterClose != 0.325 {
		t.Errorf("frame %+v", frame)
	}
	one := decode[job.Snapshot](t, f.expect(200, "GET", frame.Links["job"], ""))
	if one.Sequence == nil || one.Sequence.ID != q.ID || one.Sequence.Frame != 3 || *one.Request.ShutterOpen != 0.275 {
		t.Errorf("job %+v", one)
	}
	f.round(frame.Job, 1)
	f.expect(200, "GET", frame.Links["exr"], "")
	f.expect(200, "GET", frame.Links["png"], "")
	path := "/v1/sequences/" + q.ID
	if q = decode[job.Sequence](t, f.expect(200, "GET", path, "")); q.State != job.Rendering || q.Frames[1].RoundsDone != 1 || q.Frames[1].FilmSHA256 != "f" {
		t.Errorf("%+v", q)
	}
	if q = decode[job.Sequence](t, f.expect(200, "POST", path+"/pause", "")); !q.Frames[0].Paused {
		t.Errorf("%+v", q)
	}
	if q = decode[job.Sequence](t, f.expect(200, "POST", path+"/resume", "")); q.Frames[0].Paused {
		t.Errorf("%+v", q)
	}
	f.expectProblem(409, "", f.do("DELETE", path, ""))
	if q = decode[job.Sequence](t, f.expect(200, "POST", path+"/cancel", "")); q.State != job.Canceled || q.States[job.Canceled] != 3 {
		t.Errorf("%+v", q)
	}
	f.expect(204, "DELETE", path, "")
	for _, f3 := range q.Frames {
		f.expectProblem(404, "", f.do("GET", f3.Links["job"], ""))
	}
}

func TestSequencesAreListedByPage(t *testing.T) {
	f := newFixture(t)
	type page struct {
		Sequences []job.Sequence
		Next      string
	}
	if empty := f.expect(200, "GET", "/v1/sequences", ""); strings.TrimSpace(string(empty.body)) != `{"sequences":[]}` {
		t.Errorf("%s", empty.body)
	}
	first, second := f.submitFrames(), f.submitFrames()
	p := decode[page](t, f.expect(200, "GET", "/v1/sequences?limit=1", ""))
	if len(p.Sequences) != 1 || p.Sequences[0].ID != second.ID || p.Sequences[0].Frames != nil || p.Sequences[0].States[job.Queued] != 3 {
		t.Errorf("%+v", p)
	}
	p = decode[page](t, f.expect(200, "GET", "/v1/sequences?limit=1&cursor="+p.Next, ""))
	if len(p.Sequences) != 1 || p.Sequences[0].ID != first.ID || p.Next != "" {
		t.Errorf("%+v", p)
	}
	f.expectProblem(422, "body.cursor", f.do("GET", "/v1/sequences?cursor=none", ""))
	f.expectProblem(404, "", f.do("GET", "/v1/sequences/none", ""))
	f.expectProblem(404, "", f.do("POST", "/v1/sequences/none/cancel", ""))
	f.expectProblem(404, "", f.do("DELETE", "/v1/sequences/none", ""))
}

func TestWrongSequencesNameTheField(t *testing.T) {
	f := newFixture(t)
	for location, body := range map[string]string{
		"body.frames.end":             `{"job":{"scene":"aa","entry":"e"},"frames":{"start":5,"end":1}}`,
		"body.frames.fps":             `{"job":{"scene":"aa","entry":"e"},"frames":{"start":1,"end":5,"fps":-1}}`,
		"body.frames.seeds":           `{"job":{"scene":"aa","entry":"e"},"frames":{"start":1,"end":5,"seeds":"x"}}`,
		"body.job.shutter_open":       `{"job":{"scene":"aa","entry":"e","shutter_open":1},"frames":{"start":1,"end":5}}`,
		"body.job.integrator":         `{"job":{"scene":"aa","entry":"e","integrator":"x"},"frames":{"start":1,"end":5}}`,
		"body.frames":                 `{"job":{"scene":"aa","entry":"e"},"frames":{"start":1}}`,
		"body.frames.until":           `{"job":{"scene":"aa","entry":"e"},"frames":{"start":1,"end":2,"until":3}}`,
		"body.job.shutter_curve":      `{"job":{"scene":"aa","entry":"e","shutter_curve":[0,0]},"frames":{"start":1,"end":5}}`,
		"body.job.shutter_ramp_close": `{"job":{"scene":"aa","entry":"e","shutter_ramp_close":0.5},"frames":{"start":1,"end":5}}`,
	} {
		f.expectProblem(422, location, f.do("POST", "/v1/sequences", body))
	}
	if jobs, _, err := f.farm.Jobs(t.Context(), "", 10); err != nil || len(jobs) != 0 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
}

func TestShutterCurvesAreWordsOrNumbers(t *testing.T) {
	f := newFixture(t)
	for given, want := range map[string]string{
		`"box"`: `"box"`, `[0,0.5,1]`: `[0,0.5,1]`, `"0, 0.5, 1"`: `[0,0.5,1]`,
	} {
		a := f.expect(201, "POST", "/v1/jobs", `{"scene":"aa","entry":"e","shutter_curve":`+given+`}`)
		if !strings.Contains(string(a.body), `"shutter_curve":`+want) {
			t.Errorf("%s became %s", given, a.body)
		}
	}
	for _, wrong := range []string{`3`, `["box"]`, `{}`, `"bow"`, `[1]`} {
		f.expectProblem(422, "body.shutter_curve", f.do("POST", "/v1/jobs", `{"scene":"aa","entry":"e","shutter_curve":`+wrong+`}`))
	}
}

func TestTheInterfaceDescribesFrames(t *testing.T) {
	f := newFixture(t)
	document := decode[struct {
		Components struct {
			Schemas map[string]struct {
				Required   []string
				Properties map[string]map[string]json.RawMessage
			}
		}
	}](t, f.expect(200, "GET", "/openapi.json", ""))
	frames := document.Components.Schemas["Frames"]
	if strings.Join(frames.Required, " ") != "start end" {
		t.Errorf("required %v", frames.Required)
	}
	for name, property := range frames.Properties {
		if len(property["description"]) < 3 {
			t.Errorf("%s has no description", name)
		}
	}
	if string(frames.Properties["seeds"]["x-choices"]) != `["shared","per-frame"]` {
		t.Errorf("seeds %s", frames.Properties["seeds"]["x-choices"])
	}
	if len(document.Components.Schemas["Request"].Properties["shutter_curve"]["oneOf"]) == 0 {
		t.Error("the curve is not described")
	}
}

func TestOthersSequencesAreActedOnByAdmins(t *testing.T) {
	g := newGuarded(t, func(*api.Options) {})
	q := decode[job.Sequence](t, g.as(auth.Submit, "POST", "/v1/sequences", threeFrames))
	if q.User != auth.Submit.String() {
		t.Fatalf("%+v", q)
	}
	other := decode[job.Sequence](t, g.as(auth.Admin, "POST", "/v1/sequences", threeFrames))
	for _, action := range []string{"pause", "resume", "cancel"} {
		a := g.as(auth.Submit, "POST", "/v1/sequences/"+other.ID+"/"+action, "")
		if a.status != 403 || !strings.Contains(string(a.body), "sequence of admin") {
			t.Errorf("%s somebody else's: %d: %s", action, a.status, a.body)
		}
		if a := g.as(auth.Submit, "POST", "/v1/sequences/"+q.ID+"/"+action, ""); a.status != 200 {
			t.Errorf("%s one's own: %d: %s", action, a.status, a.body)
		}
		if a := g.as(auth.Admin, "POST", "/v1/sequences/"+other.ID+"/"+action, ""); a.status != 200 {
			t.Errorf("%s by an admin: %d: %s", action, a.status, a.body)
		}
	}
	if a := g.as(auth.Submit, "DELETE", "/v1/sequences/"+other.ID, ""); a.status != 403 || !strings.Contains(string(a.body), "sequence of admin") {
		t.Errorf("somebody else's: %d: %s", a.status, a.body)
	}
	if a := g.as(auth.Submit, "DELETE", "/v1/sequences/"+q.ID, ""); a.status != 204 {
		t.Errorf("one's own: %d: %s", a.status, a.body)
	}
	if a := g.as(auth.Admin, "DELETE", "/v1/sequences/"+other.ID, ""); a.status != 204 {
		t.Errorf("by an admin: %d: %s", a.status, a.body)
	}
}
