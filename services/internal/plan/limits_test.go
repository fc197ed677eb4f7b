package plan

import (
	"errors"
	"strings"
	"testing"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

func TestLimitsOfRequests(t *testing.T) {
	limits := Limits{Pixels: 1000, Chains: 100, PerPixel: 50}
	spec := resolve(t, job.Request{Integrator: "path"}, scene(40, 40, ""))
	SetUnit(spec, 1)
	repeated, err := FormatResolved(spec)
	if err != nil {
		t.Fatal(err)
	}
	cases := []struct {
		name    string
		request job.Request
		field   string // empty: taken
		detail  string
	}{
		{"nothing asked for", job.Request{}, "", ""},
		{"just enough", job.Request{Width: 50, Height: 20, Chains: 100, Stop: job.StopRules{SamplesPerPixel: 50}}, "", ""},
		{"wide", job.Request{Width: 51, Height: 20}, "width", "1020 pixels; this server takes at most 1000"},
		{"high", job.Request{Width: 20, Height: 51}, "height", "1020 pixels"},
		{"only width", job.Request{Width: 1001}, "width", "1001 pixels"},
		{"largest sides", job.Request{Width: 32768, Height: 32768}, "width", "1073741824 pixels"},
		{"chains", job.Request{Chains: 101}, "chains", "101 chains; this server takes at most 100"},
		{"samples", job.Request{Stop: job.StopRules{SamplesPerPixel: 51}}, "stop.samples_per_pixel", "at most 50"},
		{"mutations", job.Request{Stop: job.StopRules{MutationsPerPixel: 51}}, "stop.mutations_per_pixel", "at most 50"},
		{"a spec", job.Request{Resolved: repeated}, "resolved", "1600 pixels"},
		{"no spec", job.Request{Resolved: "{"}, "resolved", ""},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) { expectField(t, limits.CheckRequest(c.request), c.field, c.detail) })
		if err := (Limits{}).CheckRequest(c.request); err != nil && c.name != "no spec" {
			t.Errorf("%s without limits: %v", c.name, err)
		}
	}
}

func expectField(t *testing.T, err error, field, detail string) {
	t.Helper()
	var refused *job.FieldError
	switch {
	case field == "" && err != nil:
		t.Errorf("refused: %v", err)
	case field != "" && (!errors.As(err, &refused) || refused.Field != field || !strings.Contains(refused.Detail, detail)):
		t.Errorf("error %v, want one about %s with %q", err, field, detail)
	}
}

func TestLimitsOfWhatTheSceneAsksFor(t *testing.T) {
	const chains, path = "pssmlt", "path"
	cases := []struct {
		name, integrator string
		limits           Limits
		request          job.Request
		field, detail    string
	}{
		{"taken", chains, Limits{Pixels: 64 * 64, Chains: 1024, PerPixel: 64, CoordinatorBytes: 1 << 28, WorkerBytes: 1 << 28}, job.Request{}, "", ""},
		{"its size", path, Limits{Pixels: 64*64 - 1}, job.Request{}, "width", "4096 pixels"},
		{"its count", path, Limits{PerPixel: 63}, job.Request{}, "stop.samples_per_pixel", "64 per pixel"},
		{"its count, of chains", chains, Limits{PerPixel: 63}, job.Request{}, "stop.mutations_per_pixel", "64 per pixel"},
		{"chains of its size", chains, Limits{Chains: 1023}, job.Request{}, "chains", "1024 chains"},
		{"coordinator", chains, Limits{CoordinatorBytes: 1 << 20}, job.Request{}, "width", "in the coordinator; this server allows 1 MiB"},
		{"worker", chains, Limits{WorkerBytes: 1 << 20}, job.Request{Height: 65}, "height", "in each worker; this server allows 1 MiB"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			c.request.Integrator = c.integrator
			report := scene(64, 64, "")
			expectField(t, c.limits.Check(resolve(t, c.request, report), c.request, report), c.field, c.detail)
		})
	}
}

// TestMemoryHoldsAFullFilm compares with a film that light has reached everywhere.
func TestMemoryHoldsAFullFilm(t *testing.T) {
	for _, request := range []job.Request{
		{Integrator: "path"},
		{Integrator: "pssmlt", DirectApart: "on"},
		{Integrator: "mmlt", Layers: []string{"acceptance", "techniques"}},
	} {
		spec := resolve(t, request, scene(100, 70, ""))
		full := film.New(Shape(spec))
		for index := range Shape(spec).TileCount() {
			values := film.FullTileValues
			if index >= Shape(spec).TileCount()-Shape(spec).LowPlanes() {
				values = film.LowTileValues
			}
			full.Add(film.Tile{Index: index, Values: make([]int64, values)})
		}
		coordinator, worker := Memory(spec)
		chains := uint64(Chains(spec)) * chainBytes
		if got, want := coordinator, 3*(uint64(full.Bytes())+chains); got != want {
			t.Errorf("%s: %d bytes in the coordinator, want %d", request.Integrator, got, want)
		}
		if got, want := worker, uint64(full.Bytes())+chains; got != want { // two films of half the size
			t.Errorf("%s: %d bytes in a worker, want %d", request.Integrator, got, want)
		}
	}
}

func TestFilmsOfAGivenSizeAreRefusedBeforeTheSceneIsKnown(t *testing.T) {
	path, _ := Memory(smallest(job.Request{Width: 640, Height: 480}))
	limits := Limits{CoordinatorBytes: path}
	for _, c := range []struct {
		request job.Request
		field   string
	}{
		{job.Request{Width: 640, Height: 480}, ""},
		{job.Request{Width: 640, Height: 480, Integrator: job.IntegratorPSSMLT}, "width"}, // two layers
		{job.Request{Width: 480, Height: 700}, "height"},
		{job.Request{Width: 20000}, ""}, // the scene has the other side
	} {
		detail := ""
		if c.field != "" {
			detail = "in the coordinator; this server allows"
		}
		expectField(t, limits.CheckRequest(c.request), c.field, detail)
	}
}
