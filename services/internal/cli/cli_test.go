package cli

import (
	"bytes"
	"context"
	"encoding/json"
	"errors"
	"io"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/exr"
	"metrofarm/services/internal/fakefarm"
	"metrofarm/services/internal/job"
)

// fakeLocal is a Farm without processes.
type fakeLocal struct {
	*fakefarm.Farm
	library *bundle.Library
	options FarmOptions
	failed  chan error
	closed  bool
}

func (f *fakeLocal) Service() api.Service { return f.Farm }
func (f *fakeLocal) AddScene(ctx context.Context, local bundle.Local) (bundle.Scene, error) {
	return f.library.AddLocal(ctx, local)
}
func (f *fakeLocal) Dashboard() string    { return "" }
func (f *fakeLocal) Failed() <-chan error { return f.failed }
func (f *fakeLocal) Close() error         { f.closed = true; return nil }

// bench is a command line with a fake farm and a worker program that only lists files.
type bench struct {
	env            Env
	stdout, stderr bytes.Buffer
	farm           *fakeLocal
	interrupts     chan os.Signal
	dir, scene     string
}

func newBench(t *testing.T, worker string) *bench {
	t.Helper()
	b := &bench{dir: t.TempDir(), interrupts: make(chan os.Signal, 2)}
	b.scene = filepath.Join(b.dir, "scene.xml")
	program := filepath.Join(b.dir, "worker")
	for path, content := range map[string]string{b.scene: "<scene/>", program: "#!/bin/sh\n" + worker + "\n"} {
		if err := os.WriteFile(path, []byte(content), 0o700); err != nil {
			t.Fatal(err)
		}
	}
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	b.farm = &fakeLocal{
		Farm:    fakefarm.New(nil),
		library: bundle.NewLibrary(blob.New(backend), bundle.DefaultLimits(), t.TempDir()), failed: make(chan error, 1),
	}
	b.env = Env{
		Stdout: &b.stdout, Stderr: &b.stderr, CPUs: 8, Now: time.Now, Interrupts: b.interrupts, Version: "test",
		Getenv:  func(name string) string { return map[string]string{"METROFARM_WORKER": program}[name] },
		Hangups: func() <-chan os.Signal { return nil },
		StartFarm: func(_ context.Context, options FarmOptions) (Farm, error) {
			b.farm.options = options
			return b.farm, nil
		},
	}
	return b
}

const listsScene = `echo "$2"`

func (b *bench) run(t *testing.T, arguments ...string) int {
	t.Helper()
	return Run(t.Context(), b.env, arguments)
}

func (b *bench) path(name string) string { return filepath.Join(b.dir, name) }

// whenSubmitted calls then once the first job exists.
func (b *bench) whenSubmitted(t *testing.T, then func()) {
	t.Helper()
	ctx := t.Context()
	go func() {
		for ctx.Err() == nil {
			if _, err := b.farm.Job(ctx, "j1"); err == nil {
				then()
				return
			}
			time.Sleep(time.Millisecond)
		}
	}()
}

func (b *bench) completeRound() {
	image := job.Image{Width: 2, Height: 1, RGB: make([]float32, 6), Variance: make([]float32, 6)}
	point := job.ConvergencePoint{Round: 1, RelMSE: 0.5, FilmSHA256: "ff", RelMSEInterval: job.Interval{Low: 0.25, High: 1, Level: 0.95}}
	b.farm.CompleteRound("j1", point, image, func(s *job.Snapshot) {
		s.State, s.Progress, s.Resolved, s.Integrator = job.Rendering, 0.999, `{"integrator":"INTEGRATOR_PATH"}`, "path"
	})
}

func TestRenderWritesEverything(t *testing.T) {
	b := newBench(t, listsScene)
	b.whenSubmitted(t, func() {
		b.completeRound()
		_, _ = b.farm.Finish(t.Context(), "j1")
	})
	code := b.run(t, "render", "--seed", "5", b.scene, "-o", b.path("out.exr"), "--stats", b.path("s.json"),
		"--png="+b.path("out.png"), "--half", "--set", "a=1", "--max-depth", "-1")
	if code != 0 {
		t.Fatalf("exit code %d: %s", code, b.stderr.String())
	}
	file, err := os.Open(b.path("out.exr"))
	if err != nil {
		t.Fatal(err)
	}
	defer file.Close()
	if image, err := exr.Read(file); err != nil || !image.Half["R"] || image.Channels["variance.R"] == nil {
		t.Errorf("image %+v, error %v", image.Half, err)
	}
	checkStats(t, b.path("s.json"))
	s, _ := b.farm.Job(t.Context(), "j1")
	if s.Request.Seed != 5 || s.Request.Defaults["a"] != "1" || *s.Request.MaxDepth != -1 || s.Request.Entry != "scene.xml" {
		t.Errorf("request %+v", s.Request)
	}
	if !b.farm.closed || b.farm.options.Threads != 8 {
		t.Errorf("closed %v, options %+v", b.farm.closed, b.farm.options)
	}
	if _, err := os.Stat(b.farm.options.DataDir); !errors.Is(err, os.ErrNotExist) {
		t.Errorf("the temporary data is still there: %v", err)
	}
	if leftovers, _ := filepath.Glob(b.path("*.tmp")); len(leftovers) != 0 {
		t.Errorf("left over: %v", leftovers)
	}
}

func checkStats(t *testing.T, path string) {
	t.Helper()
	content, err := os.ReadFile(path)
	if err != nil {
		t.Fatal(err)
	}
	var stats map[string]json.RawMessage
	if err := json.Unmarshal(content, &stats); err != nil {
		t.Fatal(err)
	}
	for _, key := range []string{
		"integrator", "seed", "width", "height", "mutations", "path_evaluations", "rays", "rounds", "cpu_seconds",
		"wall_seconds", "load_seconds", "b", "b_standard_error", "acceptance", "rel_mse_estimate", "anomalies",
		"film_sha256", "plan", "resolved_spec",
	} {
		if stats[key] == nil {
			t.Errorf("no %s in the statistics", key)
		}
	}
	var buffer bytes.Buffer
	if err := json.Compact(&buffer, stats["rel_mse_estimate"]); err != nil || buffer.String() != `{"value":0.5,"low":0.25,"high":1,"level":0.95}` {
		t.Errorf("estimate %s", buffer.String())
	}
}

func TestRenderFailuresCreateNothing(t *testing.T) {
	cases := []struct {
		name, worker string
		then         func(*bench)
		want         string
	}{
		{"bad scene", `echo "$2:3: unknown plugin" >&2; exit 1`, func(*bench) {}, "scene.xml:3: unknown plugin\n"},
		{"failed job", listsScene, func(b *bench) {
			b.farm.Update("j1", "state", "", func(s *job.Snapshot) { s.State, s.Error = job.Failed, "scene.xml:9: no light" })
		}, "metrofarm: scene.xml:9: no light\n"},
		{"dead worker", listsScene, func(b *bench) { b.farm.failed <- errors.New("the local worker ended") }, "metrofarm: the local worker ended\n"},
		{"canceled", listsScene, func(b *bench) { _, _ = b.farm.Cancel(context.Background(), "j1") }, "was canceled\n"},
		{"no image", listsScene, func(b *bench) { _, _ = b.farm.Finish(context.Background(), "j1") }, "no round is complete"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			b := newBench(t, c.worker)
			b.whenSubmitted(t, func() { c.then(b) })
			code := b.run(t, "render", b.scene, "-o", b.path("out.exr"), "--stats", b.path("s.json"))
			if code != 1 || !strings.HasSuffix(strings.TrimSuffix(b.stderr.String(), " yet\n"), strings.TrimSuffix(c.want, " yet\n")) {
				t.Errorf("exit code %d, stderr %q, want 1 and %q", code, b.stderr.String(), c.want)
			}
			for _, name := range []string{"out.exr", "s.json"} {
				if _, err := os.Stat(b.path(name)); err == nil {
					t.Errorf("%s exists", name)
				}
			}
		})
	}
}

func TestUsageErrors(t *testing.T) {
	b := newBench(t, listsScene)
	cases := map[string][]string{
		"-o OUT.exr is missing":        {"render", b.scene},
		"usage: metrofarm render":      {"render", "-o", "x.exr"},
		`"b.xml"`:                      {"render", "a.xml", "b.xml", "-o", "x.exr"},
		"--under: belongs to pssmlt":   {"render", b.scene, "-o", "x.exr", "--integrator", "mmlt", "--under", "bdpt"},
		"--second-stage: belongs to":   {"render", b.scene, "-o", "x.exr", "--second-stage", "von-mises"},
		"--acceptance-rule: orbital":   {"render", b.scene, "-o", "x.exr", "--delayed-rejection", "on", "--kernel", "uniform", "--acceptance-rule", "orbital"},
		"--target-error":               {"render", b.scene, "-o", "x.exr", "--target-error", "-1"},
		"--integrator":                 {"render", b.scene, "-o", "x.exr", "--integrator", "magic"},
		"--light-sampling":             {"render", b.scene, "-o", "x.exr", "--light-sampling", "magic"},
		"want NAME=VALUE":              {"render", b.scene, "-o", "x.exr", "--set", "novalue"},
		"not defined: -sede":           {"render", b.scene, "-o", "x.exr", "--sede", "1"},
		"invalid value":                {"render", b.scene, "-o", "x.exr", "--seed", "-1"},
		"there is no folder":           {"render", b.scene, "-o", b.path("no/x.exr")},
		"is a folder":                  {"render", b.scene, "-o", b.dir},
		"needs --tokens":               {"serve", "--listen", "0.0.0.0:8080"},
		"needs --farm-tls-cert":        {"serve", "--farm-listen", ":7070"},
		"want HOST:PORT":               {"serve", "--listen", "8080"},
		"--store: is \"sqlite\"":       {"serve", "--store", "sqlite"},
		"--store: redis":               {"serve", "--store", "redis://x/database"},
		"say with --advertise":         {"serve", "--store", "redis://x", "--listen", "0.0.0.0:80", "--insecure"},
		"--advertise: want":            {"serve", "--advertise", "ftp://x"},
		"there is no command":          {"rendre"},
		"which command":                {},
		"--server":                     {"jobs", "--server", "nonsense"},
		"usage: metrofarm cancel ID..": {"cancel"},
		"Give --priority or --name":    {"change", "j1"},
		"want a whole number":          {"change", "j1", "--priority", "high"},
		"priority: is 101":             {"submit", b.scene, "--priority", "101"},
	}
	for want, arguments := range cases {
		b.stderr.Reset()
		code := b.run(t, arguments...)
		last := strings.TrimSpace(b.stderr.String())
		last = last[strings.LastIndex(last, "\n")+1:]
		if code != 2 || !strings.HasPrefix(last, "metrofarm: ") || !strings.Contains(last, want) {
			t.Errorf("%v: exit code %d, %q; want 2 and %q", arguments, code, last, want)
		}
	}
}

func TestHelpIsASuccess(t *testing.T) {
	b := newBench(t, listsScene)
	for name := range commands() {
		b.stdout.Reset()
		if code := b.run(t, name, "--help"); code != 0 || !strings.Contains(b.stdout.String(), "metrofarm "+name) {
			t.Errorf("%s --help: exit code %d, %q", name, code, b.stdout.String())
		}
	}
}

func TestInterrupts(t *testing.T) {
	b := newBench(t, listsScene)
	b.whenSubmitted(t, func() {
		b.completeRound()
		b.interrupts <- os.Interrupt
	})
	if code := b.run(t, "render", b.scene, "-o", b.path("out.exr")); code != 0 {
		t.Errorf("first interrupt: exit code %d, %s", code, b.stderr.String())
	}
	if _, err := os.Stat(b.path("out.exr")); err != nil {
		t.Errorf("first interrupt wrote no image: %v", err)
	}
}

func TestOutputsAreAllOrNone(t *testing.T) {
	dir := t.TempDir()
	old := filepath.Join(dir, "old")
	if err := os.WriteFile(old, []byte("old"), 0o600); err != nil {
		t.Fatal(err)
	}
	text := func(s string) func(io.Writer) error {
		return func(w io.Writer) error { _, err := io.WriteString(w, s); return err }
	}
	boom := errors.New("boom")
	err := writeOutputs(output{old, text("new")}, output{filepath.Join(dir, "b"), func(io.Writer) error { return boom }})
	if content, _ := os.ReadFile(old); !errors.Is(err, boom) || string(content) != "old" {
		t.Errorf("error %v, content %q", err, content)
	}
	if err := writeOutputs(output{old, text("new")}, output{"/dev/null", text("x")}, output{}); err != nil {
		t.Error(err)
	}
	if content, _ := os.ReadFile(old); string(content) != "new" {
		t.Errorf("content %q", content)
	}
	if entries, _ := os.ReadDir(dir); len(entries) != 1 {
		t.Errorf("%d files, want 1", len(entries))
	}
}
