package api_test

import (
	"bufio"
	"context"
	"fmt"
	"io"
	"log/slog"
	"net/http"
	"strings"
	"sync"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/bundle"
)

func TestClientsThatAskTooOftenWait(t *testing.T) {
	g := newGuarded(t, func(o *api.Options) {
		o.Limits = api.DefaultLimits()
		o.Limits.RequestsPerSecond, o.Limits.Burst = 0.5, 3
	})
	for range 3 {
		g.expect(200, "GET", "/v1/jobs", "", "Authorization", "Bearer "+g.tokens[auth.Read])
	}
	refused := g.as(auth.Read, "GET", "/v1/jobs", "")
	g.expectProblem(http.StatusTooManyRequests, "", refused)
	if got := refused.header.Get("Retry-After"); got != "2" {
		t.Errorf("Retry-After %q, want 2", got)
	}
	g.expect(200, "GET", "/healthz", "")
	if got := g.as(auth.Admin, "GET", "/v1/jobs", ""); got.status != 200 {
		t.Errorf("another token pays for it: %d", got.status)
	}
	cookie, _ := g.login(auth.Admin) // the token's second and, with the cookie, third
	g.expect(200, "GET", "/v1/jobs", "", "Cookie", cookie)
	g.expectProblem(http.StatusTooManyRequests, "", g.do("GET", "/v1/jobs", "", "Cookie", cookie))
	g.now = g.now.Add(2 * time.Second)
	g.expect(200, "GET", "/v1/jobs", "", "Authorization", "Bearer "+g.tokens[auth.Read])
	g.expectProblem(http.StatusTooManyRequests, "", g.as(auth.Read, "GET", "/v1/jobs", ""))
}

func TestWrongTokensCountForTheAddress(t *testing.T) {
	g := newGuarded(t, func(o *api.Options) {
		o.Limits = api.DefaultLimits()
		o.Limits.RequestsPerSecond, o.Limits.Burst = 1, 5
	})
	for i := range 5 {
		g.expectProblem(401, "", g.do("GET", "/v1/jobs", "", "Authorization", fmt.Sprintf("Bearer guess-%d", i)))
	}
	g.expectProblem(http.StatusTooManyRequests, "", g.do("GET", "/v1/jobs", "", "Authorization", "Bearer guess"))
	g.expect(200, "GET", "/v1/jobs", "", "Authorization", "Bearer "+g.tokens[auth.Read])
}

// slowScenes keeps the first uploads until it is told to end them.
type slowScenes struct {
	first   atomic.Int32
	arrived chan struct{}
	end     chan struct{}
}

func (s *slowScenes) AddArchive(ctx context.Context, _ io.Reader) (bundle.Scene, error) {
	if s.first.Add(-1) < 0 {
		return bundle.Scene{}, nil
	}
	s.arrived <- struct{}{}
	select {
	case <-s.end:
	case <-ctx.Done():
	}
	return bundle.Scene{}, nil
}

func (s *slowScenes) Limits() bundle.Limits { return bundle.DefaultLimits() }

func (s *slowScenes) Scenes(context.Context) ([]bundle.Listed, error) { return nil, nil }

func (s *slowScenes) Scene(context.Context, string) (bundle.Scene, error) { return bundle.Scene{}, nil }

func TestOnlySoManyUploadsAtATime(t *testing.T) {
	scenes := &slowScenes{arrived: make(chan struct{}, 10), end: make(chan struct{})}
	scenes.first.Store(2)
	f := newFixtureWith(t, func(o *api.Options) {
		o.Scenes, o.Limits = scenes, api.DefaultLimits()
		o.Limits.Uploads = 2
	})
	var uploads sync.WaitGroup
	for range 2 {
		uploads.Go(func() {
			if got := f.do("POST", "/v1/scenes", "x"); got.status != http.StatusCreated {
				t.Errorf("upload: %d %s", got.status, got.body)
			}
		})
		<-scenes.arrived
	}
	refused := f.do("POST", "/v1/scenes", "x")
	f.expectProblem(http.StatusServiceUnavailable, "", refused)
	if refused.header.Get("Retry-After") == "" {
		t.Error("no Retry-After")
	}
	close(scenes.end)
	uploads.Wait()
	f.expect(http.StatusCreated, "POST", "/v1/scenes", "x")
}

// drip sends an upload byte by byte and returns the answer.
func (f *fixture) drip(contentType, start string, pause time.Duration) answer {
	f.t.Helper()
	r, w := io.Pipe()
	sent := make(chan struct{})
	go func() {
		defer close(sent)
		for _, err := io.WriteString(w, start); err == nil; _, err = io.WriteString(w, "x") {
			time.Sleep(pause)
		}
	}()
	request, err := http.NewRequestWithContext(f.t.Context(), http.MethodPost, f.server.URL+"/v1/scenes", r)
	if err != nil {
		f.t.Fatal(err)
	}
	request.Header.Set("Content-Type", contentType)
	got := f.answer(request)
	r.Close()
	<-sent
	return got
}

const (
	formType  = "multipart/form-data; boundary=b"
	formStart = "--b\r\nContent-Disposition: form-data; name=\"other\"\r\n\r\n"
)

// TestASlowUploadLosesItsPlace: each byte comes in time, but all together are behind.
func TestASlowUploadLosesItsPlace(t *testing.T) {
	f := newFixtureWith(t, func(o *api.Options) {
		o.Limits = api.DefaultLimits()
		o.Limits.Uploads, o.Limits.UploadPatience = 2, time.Second
	})
	var uploads sync.WaitGroup
	for contentType, start := range map[string]string{"application/zip": "PK\x03\x04", formType: formStart} {
		uploads.Go(func() {
			if got := f.drip(contentType, start, 10*time.Millisecond); got.status != http.StatusRequestTimeout {
				t.Errorf("%s: %d %s", contentType, got.status, got.body)
			}
		})
	}
	uploads.Wait()
	f.expect(http.StatusCreated, "POST", "/v1/scenes", zipOf(t, map[string]string{"scene.xml": "<scene/>"}))
}

// TestPartsBeforeTheFileCount: they are a part of the upload.
func TestPartsBeforeTheFileCount(t *testing.T) {
	f := newFixture(t)
	body := struct{ io.Reader }{strings.NewReader(formStart + strings.Repeat("x", 160<<10))} // of a length that nobody knows
	request, err := http.NewRequestWithContext(t.Context(), http.MethodPost, f.server.URL+"/v1/scenes", body)
	if err != nil {
		t.Fatal(err)
	}
	request.Header.Set("Content-Type", formType)
	f.expectProblem(http.StatusRequestEntityTooLarge, "body", f.answer(request))
}

// stream opens an event stream, and waits for its first line where it is granted.
func (g *guarded) stream(role auth.Role, id string) (status int, end func()) {
	g.t.Helper()
	ctx, cancel := context.WithCancel(g.t.Context())
	request, err := http.NewRequestWithContext(ctx, http.MethodGet, g.server.URL+"/v1/jobs/"+id+"/events", nil)
	if err != nil {
		g.t.Fatal(err)
	}
	request.Header.Set("Authorization", "Bearer "+g.tokens[role])
	response, err := g.server.Client().Do(request)
	if err != nil {
		g.t.Fatal(err)
	}
	if response.StatusCode == http.StatusOK {
		if _, err := bufio.NewReader(response.Body).ReadString('\n'); err != nil {
			g.t.Fatal(err)
		}
	}
	return response.StatusCode, func() {
		cancel()
		response.Body.Close()
	}
}

func TestOnlySoManyEventStreams(t *testing.T) {
	g := newGuarded(t, func(o *api.Options) {
		o.Limits = api.DefaultLimits()
		o.Limits.StreamsPerClient, o.Limits.Streams = 2, 3
	})
	g.as(auth.Admin, "POST", "/v1/jobs", request)
	expect := func(role auth.Role, want int) func() {
		t.Helper()
		status, end := g.stream(role, "j1")
		if status != want {
			t.Errorf("as %s: %d, want %d", role, status, want)
		}
		return end
	}
	first := expect(auth.Read, 200)
	expect(auth.Read, 200)
	expect(auth.Read, http.StatusTooManyRequests)
	expect(auth.Submit, 200)
	expect(auth.Admin, http.StatusServiceUnavailable)
	first()
	deadline := time.Now().Add(10 * time.Second)
	for {
		status, _ := g.stream(auth.Admin, "j1")
		if status == 200 {
			break
		}
		if time.Now().After(deadline) {
			t.Fatalf("the place of a stream that ended is not free: %d", status)
		}
		time.Sleep(10 * time.Millisecond)
	}
}

func TestBodiesAreLimited(t *testing.T) {
	f := newFixtureWith(t, func(o *api.Options) {
		o.Limits = api.DefaultLimits()
		o.Limits.BodyBytes = 1000
	})
	name := `{"scene":"aa","entry":"` + strings.Repeat("a", 900) + `"}`
	f.expect(http.StatusCreated, "POST", "/v1/jobs", name)
	f.expectProblem(http.StatusRequestEntityTooLarge, "", f.do("POST", "/v1/jobs", name+strings.Repeat(" ", 100)))
}

// TestSilentConnectionsEnd is what keeps clients that never finish their headers from using up the
// server's connections.
func TestSilentConnectionsEnd(t *testing.T) {
	server := api.NewHTTPServer(http.NotFoundHandler(), slog.New(slog.DiscardHandler))
	for name, timeout := range map[string]time.Duration{"headers": server.ReadHeaderTimeout, "idle": server.IdleTimeout} {
		if timeout <= 0 || timeout > 5*time.Minute {
			t.Errorf("%s: %s", name, timeout)
		}
	}
	if server.MaxHeaderBytes <= 0 || server.MaxHeaderBytes > 1<<20 {
		t.Errorf("headers of %d bytes", server.MaxHeaderBytes)
	}
}
