package api_test

import (
	"archive/zip"
	"bytes"
	"encoding/json"
	"io"
	"net/http"
	"net/http/httptest"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/fakefarm"
	"metrofarm/services/internal/job"
)

type fixture struct {
	t      *testing.T
	farm   *fakefarm.Farm
	server *httptest.Server
}

func newFixture(t *testing.T) *fixture {
	t.Helper()
	return newFixtureWith(t, func(*api.Options) {})
}

func newFixtureWith(t *testing.T, change func(*api.Options)) *fixture {
	t.Helper()
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	limits := bundle.Limits{UploadBytes: 1 << 16, UnpackedBytes: 1 << 18, Files: 10}
	start := time.Date(2026, 1, 2, 3, 4, 5, 0, time.UTC)
	farm := fakefarm.New(func() time.Time { return start })
	var _ api.Service = farm
	options := api.Options{
		Service: farm, Scenes: bundle.NewLibrary(blob.New(backend), limits, t.TempDir()),
		Heartbeat: 20 * time.Millisecond, FarmInterval: 10 * time.Millisecond, CheckHosts: true, Version: "test",
	}
	change(&options)
	handler, err := api.NewHandler(options)
	if err != nil {
		t.Fatal(err)
	}
	f := &fixture{t: t, farm: farm, server: httptest.NewServer(handler)}
	t.Cleanup(f.server.Close)
	return f
}

type answer struct {
	status int
	header http.Header
	body   []byte
}

func (f *fixture) do(method, path, body string, headers ...string) answer {
	f.t.Helper()
	request, err := http.NewRequestWithContext(f.t.Context(), method, f.server.URL+path, strings.NewReader(body))
	if err != nil {
		f.t.Fatal(err)
	}
	for i := 0; i < len(headers); i += 2 {
		if headers[i] == "Host" {
			request.Host = headers[i+1]
		}
		request.Header.Set(headers[i], headers[i+1])
	}
	return f.answer(request)
}

func (f *fixture) answer(request *http.Request) answer {
	f.t.Helper()
	response, err := f.server.Client().Do(request)
	if err != nil {
		f.t.Fatal(err)
	}
	defer response.Body.Close()
	content, err := io.ReadAll(response.Body)
	if err != nil {
		f.t.Fatal(err)
	}
	return answer{response.StatusCode, response.Header, content}
}

func (f *fixture) expect(status int, method, path, body string, headers ...string) answer {
	f.t.Helper()
	got := f.do(method, path, body, headers...)
	if got.status != status {
		f.t.Fatalf("%s %s: %d, want %d: %s", method, path, got.status, status, got.body)
	}
	return got
}

const request = `{"scene":"aa","entry":"scene.xml"}`

// submit adds a job and returns its id.
func (f *fixture) submit() string {
	f.t.Helper()
	return decode[job.Snapshot](f.t, f.expect(201, "POST", "/v1/jobs", request)).ID
}

// round completes round n of a job with a small image.
func (f *fixture) round(id string, n int) {
	point := job.ConvergencePoint{
		Round: n, Mutations: uint64(1000 * n), RelMSE: 0.5 / float64(n), B: 0.25,
		RelMSEInterval: job.Interval{Low: 0.25, High: 1, Level: 0.95}, FilmSHA256: strings.Repeat("f", n),
	}
	image := job.Image{
		Width: 2, Height: 1, RGB: []float32{1, 0.5, 0, 0, 0.5, 1}, Variance: make([]float32, 6),
		JobID: id, Rounds: n,
	}
	f.farm.CompleteRound(id, point, image, func(s *job.Snapshot) { s.State = job.Rendering })
}

func decode[T any](t *testing.T, a answer) T {
	t.Helper()
	var value T
	if err := json.Unmarshal(a.body, &value); err != nil {
		t.Fatalf("%v in %s", err, a.body)
	}
	return value
}

type problem struct {
	Status        int
	Title, Detail string
	Errors        []struct{ Message, Location string }
}

func (f *fixture) expectProblem(status int, location string, got answer) {
	f.t.Helper()
	if got.status != status || got.header.Get("Content-Type") != "application/problem+json" {
		f.t.Fatalf("%d %s, want problem %d: %s", got.status, got.header.Get("Content-Type"), status, got.body)
	}
	p := decode[problem](f.t, got)
	if p.Status != status || p.Title == "" || p.Detail == "" {
		f.t.Errorf("problem %+v is not complete", p)
	}
	if location == "" {
		return
	}
	for _, e := range p.Errors {
		if e.Location == location && e.Message != "" {
			return
		}
	}
	f.t.Errorf("problem %s does not name %s", got.body, location)
}

func zipOf(t *testing.T, files map[string]string) string {
	t.Helper()
	var buffer bytes.Buffer
	w := zip.NewWriter(&buffer)
	for name, content := range files {
		f, err := w.Create(name)
		if err == nil {
			_, err = io.WriteString(f, content)
		}
		if err != nil {
			t.Fatal(err)
		}
	}
	if err := w.Close(); err != nil {
		t.Fatal(err)
	}
	return buffer.String()
}
