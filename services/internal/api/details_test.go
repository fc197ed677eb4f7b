package api_test

import (
	"bufio"
	"bytes"
	"image/png"
	"mime/multipart"
	"net/http"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/exr"
	"metrofarm/services/internal/job"
)

func TestSceneUpload(t *testing.T) {
	f := newFixture(t)
	archive := zipOf(t, map[string]string{"scene.xml": "<scene/>", "meshes/a.ply": "ply"})
	direct := decode[bundle.Scene](t, f.expect(201, "POST", "/v1/scenes", archive, "Content-Type", "application/zip"))
	if len(direct.Files) != 2 || len(direct.Entries) != 1 || direct.Entries[0] != "scene.xml" {
		t.Errorf("scene %+v", direct)
	}
	var form bytes.Buffer
	w := multipart.NewWriter(&form)
	part, err := w.CreateFormFile("file", "scene.zip")
	if err == nil {
		_, err = part.Write([]byte(archive))
	}
	if err != nil || w.Close() != nil {
		t.Fatal(err)
	}
	posted := decode[bundle.Scene](t, f.expect(201, "POST", "/v1/scenes", form.String(), "Content-Type", w.FormDataContentType()))
	stored := decode[bundle.Scene](t, f.expect(200, "GET", "/v1/scenes/"+direct.Digest, ""))
	if posted.Digest != direct.Digest || stored.Digest != direct.Digest {
		t.Errorf("digests %s, %s, %s", direct.Digest, posted.Digest, stored.Digest)
	}
	f.expectProblem(404, "", f.do("GET", "/v1/scenes/"+strings.Repeat("0", 64), ""))
}

func TestSceneUploadRefusals(t *testing.T) {
	f := newFixture(t)
	evil := f.do("POST", "/v1/scenes", zipOf(t, map[string]string{"../evil": "x"}), "Content-Type", "application/zip")
	f.expectProblem(422, "body", evil)
	if !strings.Contains(string(evil.body), "../evil") {
		t.Errorf("%s does not name the entry", evil.body)
	}
	f.expectProblem(422, "", f.do("POST", "/v1/scenes", "text"))
	f.expectProblem(422, "", f.do("POST", "/v1/scenes", ""))
	bomb := zipOf(t, map[string]string{"bomb": strings.Repeat("\x00", 1<<19)})
	f.expectProblem(413, "", f.do("POST", "/v1/scenes", bomb))
	f.expectProblem(413, "", f.do("POST", "/v1/scenes", strings.Repeat("PK\x03\x04", 1<<15)))
	f.expectProblem(422, "body.file", f.do("POST", "/v1/scenes", "--x\r\n\r\n--x--\r\n", "Content-Type", "multipart/form-data; boundary=x"))
}

func TestImages(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	f.expectProblem(409, "", f.do("GET", "/v1/jobs/"+id+"/image.png", ""))
	f.round(id, 1)
	picture := f.expect(200, "GET", "/v1/jobs/"+id+"/image.png?exposure=0", "")
	if _, err := png.Decode(bytes.NewReader(picture.body)); err != nil || picture.header.Get("Content-Type") != "image/png" {
		t.Errorf("%s, %v", picture.header.Get("Content-Type"), err)
	}
	f.expect(200, "GET", "/v1/jobs/"+id+"/image.png", "")
	for _, wrong := range []string{"NaN", "21", "bright"} {
		f.expectProblem(422, "query.exposure", f.do("GET", "/v1/jobs/"+id+"/image.png?exposure="+wrong, ""))
	}
	for precision, half := range map[string]bool{"half": true, "float": false} {
		got := f.expect(200, "GET", "/v1/jobs/"+id+"/image.exr?precision="+precision, "")
		file, err := exr.Read(bytes.NewReader(got.body))
		if err != nil || file.Half["R"] != half || file.Channels["variance.R"] == nil {
			t.Errorf("%s: %v, error %v", precision, file.Half, err)
		}
	}
	tag := picture.header.Get("ETag")
	if tag != `"f"` {
		t.Errorf("ETag %s, want the film's hash", tag)
	}
	f.expect(304, "GET", "/v1/jobs/"+id+"/image.exr", "", "If-None-Match", tag)
	f.round(id, 2)
	f.expect(200, "GET", "/v1/jobs/"+id+"/image.exr", "", "If-None-Match", tag)
}

func TestConvergencePlanAnomaliesLog(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	if got := f.expect(200, "GET", "/v1/jobs/"+id+"/convergence", ""); string(got.body) != `{"points":[]}` {
		t.Errorf("no points: %s", got.body)
	}
	f.round(id, 1)
	f.round(id, 2)
	csv := f.expect(200, "GET", "/v1/jobs/"+id+"/convergence?format=csv", "")
	lines := strings.Split(strings.TrimSpace(string(csv.body)), "\n")
	if len(lines) != 3 || lines[2] != "2,2000,0,0,0.25,0.25,1,0.25,0,0,0,ff,,,,,0,0" {
		t.Errorf("CSV %q", lines)
	}
	f.farm.Update(id, "anomaly", "2 NaN in emission", func(s *job.Snapshot) {
		s.Anomalies = map[string]uint64{"nan": 2}
		s.Resolved = `{"integrator":"INTEGRATOR_PATH"}`
	})
	anomalies := string(f.expect(200, "GET", "/v1/jobs/"+id+"/anomalies", "").body)
	if !strings.Contains(anomalies, `"total":2`) || !strings.Contains(anomalies, "2 NaN in emission") {
		t.Errorf("anomalies %s", anomalies)
	}
	plan := string(f.expect(200, "GET", "/v1/jobs/"+id+"/plan", "").body)
	if !strings.Contains(plan, `"value":"path"`) || !strings.Contains(plan, `"resolved":{"integrator"`) ||
		!strings.Contains(plan, `{"name":"light subpaths","state":"skipped"`) {
		t.Errorf("plan %s", plan)
	}
	log := string(f.expect(200, "GET", "/v1/jobs/"+id+"/log", "").body)
	if !strings.HasPrefix(log, "2026-01-02T03:04:05Z state    queued\n") || strings.Count(log, "\n") != 4 {
		t.Errorf("log %q", log)
	}
}

// readEvents reads from a stream until a line starts with until.
func (f *fixture) readEvents(path, until string, headers ...string) string {
	f.t.Helper()
	request, err := http.NewRequestWithContext(f.t.Context(), http.MethodGet, f.server.URL+path, nil)
	if err != nil {
		f.t.Fatal(err)
	}
	for i := 0; i < len(headers); i += 2 {
		request.Header.Set(headers[i], headers[i+1])
	}
	response, err := f.server.Client().Do(request)
	if err != nil {
		f.t.Fatal(err)
	}
	defer response.Body.Close()
	if got := response.Header.Get("Content-Type"); got != "text/event-stream" {
		f.t.Fatalf("Content-Type %s", got)
	}
	var text strings.Builder
	lines := bufio.NewScanner(response.Body)
	for lines.Scan() {
		text.WriteString(lines.Text() + "\n")
		if strings.HasPrefix(lines.Text(), until) {
			return text.String()
		}
	}
	return text.String() + "(end)"
}

func TestEventStream(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	f.round(id, 1)
	path := "/v1/jobs/" + id + "/events"
	past := f.readEvents(path, ":")
	if !strings.Contains(past, "id: 1\nevent: state\ndata: {") || !strings.Contains(past, "id: 2\nevent: round\n") {
		t.Errorf("past events and a heartbeat: %s", past)
	}
	resumed := f.readEvents(path, ":", "Last-Event-ID", "1")
	if strings.Contains(resumed, "id: 1\n") || !strings.Contains(resumed, "id: 2\n") {
		t.Errorf("resumed after 1: %s", resumed)
	}
	time.AfterFunc(50*time.Millisecond, func() { f.round(id, 2) })
	live := f.readEvents(path+"?after=2", "id: 3")
	if strings.Contains(live, "id: 2\n") || strings.Contains(live, "(end)") {
		t.Errorf("live events: %s", live)
	}
	time.AfterFunc(50*time.Millisecond, func() { f.farm.DropWatchers(id) })
	if dropped := f.readEvents(path, "never"); !strings.HasSuffix(dropped, "(end)") {
		t.Errorf("the stream went on after its source had closed: %s", dropped)
	}
}

func TestWorkersAndAutoscale(t *testing.T) {
	f := newFixture(t)
	if got := f.expect(200, "GET", "/v1/workers", ""); string(got.body) != "{\"workers\":[]}\n" {
		t.Errorf("no workers: %s", got.body)
	}
	f.farm.SetWorkers(job.Worker{ID: "w1", State: "busy"}, job.Worker{ID: "w2", State: "lost"})
	if w := decode[job.Worker](t, f.expect(200, "POST", "/v1/workers/w1/drain", "")); w.State != "draining" {
		t.Errorf("worker %+v", w)
	}
	f.expectProblem(404, "", f.do("POST", "/v1/workers/w9/drain", ""))
	f.farm.SetWorkers(job.Worker{ID: "w1", State: "busy"}, job.Worker{ID: "w2", State: "lost"})
	big, paused, done := f.submit(), f.submit(), f.submit()
	f.farm.Update(big, "progress", "", func(s *job.Snapshot) { s.RoundSegments = 33 })
	f.farm.Update(paused, "state", "", func(s *job.Snapshot) { s.Paused = true })
	f.farm.Update(done, "state", "", func(s *job.Snapshot) { s.State = job.Done })
	got := decode[api.Autoscale](t, f.expect(200, "GET", "/v1/autoscale", ""))
	if want := (api.Autoscale{DesiredWorkers: 3, ActiveJobs: 1, Workers: 1}); got != want {
		t.Errorf("%+v, want %+v", got, want)
	}
}

func TestHealthAndMetrics(t *testing.T) {
	f := newFixture(t)
	for _, path := range []string{"/healthz", "/readyz", "/metrics", "/", "/docs"} {
		f.expect(200, "GET", path, "")
	}
}
