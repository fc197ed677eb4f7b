package api_test

import (
	"bufio"
	"bytes"
	"image/png"
	"io"
	"mime/multipart"
	"net/http"
	"strconv"
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
	f.expectProblem(422, "body.file", f.do("POST", "/v1/scenes", "--x\r\n\r\n--x--\r\n", "Content-Type", "multipart/form-data; boundary=x"))
}

func TestSceneUploadLimits(t *testing.T) {
	f := newFixture(t) // takes 64 KiB that unpack to 256 KiB in 10 files
	many := map[string]string{}
	for i := range 11 {
		many[strconv.Itoa(i)] = ""
	}
	long := strings.Repeat("PK\x03\x04", 1<<15)
	for name, c := range map[string]struct{ archive, want string }{
		"bytes":          {long, "65536 bytes (64 KiB)"},
		"many bytes":     {long + long, "65536 bytes (64 KiB)"},
		"unpacked bytes": {zipOf(t, map[string]string{"bomb": strings.Repeat("\x00", 1<<19)}), `"bomb", it unpacks to more than the 262144 bytes`},
		"files":          {zipOf(t, many), "one more than the 10 files"},
		"within all":     {zipOf(t, map[string]string{"scene.xml": strings.Repeat("x", 1<<18)}), ""},
	} {
		t.Run(name, func(t *testing.T) {
			got := f.do("POST", "/v1/scenes", c.archive)
			if c.want == "" {
				if got.status != http.StatusCreated {
					t.Errorf("%d: %s", got.status, got.body)
				}
				return
			}
			f.expectProblem(http.StatusRequestEntityTooLarge, "body", got)
			if p := decode[problem](t, got); !strings.Contains(p.Detail, c.want) {
				t.Errorf("%q does not say %q", p.Detail, c.want)
			}
		})
	}
}

// TestATooLongUploadIsRefusedBeforeItIsSent: a client that asks first hears it at once.
func TestATooLongUploadIsRefusedBeforeItIsSent(t *testing.T) {
	f := newFixture(t)
	body := &countingReader{r: strings.NewReader(strings.Repeat("x", 1<<20))}
	request, err := http.NewRequestWithContext(t.Context(), http.MethodPost, f.server.URL+"/v1/scenes", body)
	if err != nil {
		t.Fatal(err)
	}
	request.ContentLength = 1 << 20
	request.Header.Set("Expect", "100-continue")
	client := &http.Client{Transport: &http.Transport{ExpectContinueTimeout: time.Minute}}
	response, err := client.Do(request)
	if err != nil {
		t.Fatal(err)
	}
	defer response.Body.Close()
	if response.StatusCode != http.StatusRequestEntityTooLarge || body.read != 0 {
		t.Errorf("status %d after %d bytes", response.StatusCode, body.read)
	}
}

type countingReader struct {
	r    io.Reader
	read int
}

func (c *countingReader) Read(p []byte) (int, error) {
	n, err := c.r.Read(p)
	c.read += n
	return n, err
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
	if !strings.HasPrefix(log, "2026-01-02T03:04:05Z state    queued (state=queued)\n") || strings.Count(log, "\n") != 4 ||
		!strings.Contains(log, " round    round 2 (b=0.25, ") || !strings.Contains(log, "rel_mse=0.25") {
		t.Errorf("log %q", log)
	}
	asJSON := string(f.expect(200, "GET", "/v1/jobs/"+id+"/log?format=json&after=2", "").body)
	records := strings.Split(strings.TrimSpace(asJSON), "\n")
	if len(records) != 2 || !strings.HasPrefix(records[0], `{"sequence":3,"timestamp":"2026-01-02T03:04:05Z","severity_text":"INFO","kind":"round",`) ||
		!strings.Contains(records[0], `"rel_mse":0.25`) || !strings.Contains(records[1], `"severity_text":"WARN"`) {
		t.Errorf("log %s", asJSON)
	}
	f.expectProblem(422, "query.format", f.do("GET", "/v1/jobs/"+id+"/log?format=xml", ""))
}

// readEvents reads from a stream until a line starts with until.
func (f *fixture) readEvents(path, until string, headers ...string) string {
	f.t.Helper()
	return f.openEvents(path, headers...).until(until)
}

// stream is an open stream of events.
type stream struct {
	body  io.ReadCloser
	lines *bufio.Scanner
}

// openEvents returns once the stream is subscribed to: that is before its headers are sent.
func (f *fixture) openEvents(path string, headers ...string) *stream {
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
	if got := response.Header.Get("Content-Type"); got != "text/event-stream" {
		f.t.Fatalf("Content-Type %s", got)
	}
	return &stream{body: response.Body, lines: bufio.NewScanner(response.Body)}
}

// until reads on to a line that begins so and closes the stream, or to its end.
func (s *stream) until(beginning string) string {
	defer s.body.Close()
	text, found := s.upTo(beginning)
	if !found {
		text += "(end)"
	}
	return text
}

// upTo reads on to a line that begins so.
func (s *stream) upTo(beginning string) (text string, found bool) {
	var read strings.Builder
	for s.lines.Scan() {
		read.WriteString(s.lines.Text() + "\n")
		if strings.HasPrefix(s.lines.Text(), beginning) {
			return read.String(), true
		}
	}
	return read.String(), false
}

func TestAStreamTellsThatItsJobWasDeleted(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	f.expect(200, "POST", "/v1/jobs/"+id+"/cancel", "")
	path := "/v1/jobs/" + id + "/events"
	deleted := f.openEvents(path)
	if err := f.farm.Delete(t.Context(), id); err != nil {
		t.Fatal(err)
	}
	if text := deleted.until("(none)"); !strings.Contains(text, "id: 3\nevent: deleted\ndata: {") || !strings.HasSuffix(text, "\n\n(end)") {
		t.Errorf("the stream of a deleted job: %s", text)
	}
	other := f.submit()
	kept := f.openEvents("/v1/jobs/" + other + "/events")
	f.farm.DropWatchers(other)
	if text := kept.until("(none)"); strings.Contains(text, "deleted") {
		t.Errorf("the stream of a job that is there: %s", text)
	}
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
	following := f.openEvents(path + "?after=2")
	f.round(id, 2)
	live := following.until("id: 3")
	if strings.Contains(live, "id: 2\n") || strings.Contains(live, "(end)") {
		t.Errorf("live events: %s", live)
	}
	following = f.openEvents(path)
	f.farm.DropWatchers(id)
	if dropped := following.until("never"); !strings.HasSuffix(dropped, "(end)") {
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
