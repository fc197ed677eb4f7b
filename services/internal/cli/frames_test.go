package cli

import (
	"net/http/httptest"
	"os"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/job"
)

func TestFramePaths(t *testing.T) {
	for _, c := range []struct {
		pattern string
		number  int
		want    string
	}{
		{"out.####.exr", 7, "out.0007.exr"},
		{"out.##.exr", 1234, "out.1234.exr"},
		{"a#/b#.exr", 5, "a#/b5.exr"},
		{"#", 0, "0"},
		{"", 5, ""},
	} {
		if got := framePath(c.pattern, c.number); got != c.want {
			t.Errorf("frame %d of %q is %q, want %q", c.number, c.pattern, got, c.want)
		}
	}
}

func TestFramesNeedNumberedOutputs(t *testing.T) {
	b := newBench(t, listsScene)
	for want, arguments := range map[string][]string{
		"out.exr has no #":           {"render", b.scene, "-o", b.path("out.exr"), "--frames", "1-3"},
		"x.png has no #":             {"render", b.scene, "-o", b.path("#.exr"), "--png", b.path("x.png"), "--frames", "1-3"},
		"want FIRST-LAST":            {"render", b.scene, "-o", b.path("#.exr"), "--frames", "1..3"},
		"--frames: end is 1, ":       {"render", b.scene, "-o", b.path("#.exr"), "--frames", "3-1"},
		"--frames: end makes 1001":   {"render", b.scene, "-o", b.path("#.exr"), "--frames", "0-1000"},
		"--frame-step: is -1":        {"render", b.scene, "-o", b.path("#.exr"), "--frames", "1-3", "--frame-step", "-1"},
		"--fps: belongs to --frames": {"render", b.scene, "-o", b.path("#.exr"), "--fps", "24"},
		"--shutter-open: belongs to": {"render", b.scene, "-o", b.path("#.exr"), "--frames", "1-3", "--shutter-open", "0"},
		"--frame-seeds: is \"x\"":    {"submit", b.scene, "--frames", "1-3", "--frame-seeds", "x"},
		"--shutter-angle: is -1":     {"submit", b.scene, "--frames", "1-3", "--shutter-angle", "-1"},
		"--resolved: belongs to":     {"submit", b.scene, "--frames", "1-3", "--resolved", b.scene},
		"want a number":              {"submit", b.scene, "--shutter-open", "noon"},
		"--shutter-curve: is \"x\"":  {"submit", b.scene, "--shutter-curve", "x"},
	} {
		b.stderr.Reset()
		if code := b.run(t, arguments...); code != 2 || !strings.Contains(b.stderr.String(), want) {
			t.Errorf("%v: exit code %d, %q; want 2 and %q", arguments, code, b.stderr.String(), want)
		}
	}
}

func TestShutterFlagsReachTheRequest(t *testing.T) {
	var r requestFlags
	f := newFlags("render", newBench(t, listsScene).env)
	r.register(f)
	arguments := []string{
		"--shutter-open", "-0.5", "--shutter-close", "0", "--shutter-curve", "trapezoid", "--shutter-ramp-open", "0.25",
		"--shutter-ramp-close=0.5", "--exposure", "camera", "--rolling-shutter", "-0.125", "scene.xml",
	}
	if _, err := f.parse(arguments, 1, 1); err != nil {
		t.Fatal(err)
	}
	if err := r.finish(); err != nil {
		t.Fatal(err)
	}
	got := r.request
	if got.ShutterOpen == nil || *got.ShutterOpen != -0.5 || got.ShutterClose == nil || *got.ShutterClose != 0 || got.ShutterCurve != job.CurveTrapezoid ||
		got.ShutterRampOpen != 0.25 || got.ShutterRampClose != 0.5 || got.Exposure != job.ExposureCamera || got.RollingShutter != -0.125 {
		t.Errorf("request %+v", got)
	}
}

// rounds completes a round of each job and ends it as asked, as soon as it is there.
func (b *bench) rounds(t *testing.T, ends map[string]func()) {
	t.Helper()
	ctx := t.Context()
	for id, end := range ends {
		go func() {
			for ctx.Err() == nil {
				if _, err := b.farm.Job(ctx, id); err == nil {
					image := job.Image{Width: 2, Height: 1, RGB: make([]float32, 6), Variance: make([]float32, 6)}
					b.farm.CompleteRound(id, job.ConvergencePoint{Round: 1, FilmSHA256: id}, image, func(*job.Snapshot) {})
					end()
					return
				}
				time.Sleep(time.Millisecond)
			}
		}()
	}
}

func (b *bench) finish(t *testing.T, id string) func() {
	return func() { _, _ = b.farm.Finish(t.Context(), id) }
}

func TestRenderFrames(t *testing.T) {
	b := newBench(t, listsScene)
	b.rounds(t, map[string]func(){"j1": b.finish(t, "j1"), "j2": b.finish(t, "j2"), "j3": b.finish(t, "j3")})
	code := b.run(t, "render", b.scene, "--frames", "8-12", "--frame-step", "2", "--fps", "10", "--shutter-angle", "360",
		"--frame-seeds", "per-frame", "--seed", "5", "-o", b.path("out.###.exr"), "--stats", b.path("s#.json"))
	if code != 0 {
		t.Fatalf("exit code %d: %s", code, b.stderr.String())
	}
	for _, name := range []string{"out.008.exr", "out.010.exr", "out.012.exr", "s8.json", "s10.json", "s12.json"} {
		if _, err := os.Stat(b.path(name)); err != nil {
			t.Error(err)
		}
	}
	j, err := b.farm.Job(t.Context(), "j2")
	if err != nil || j.Request.Seed != 15 || *j.Request.ShutterOpen != 0.95 || *j.Request.ShutterClose != 1.05 {
		t.Errorf("job %+v, error %v", j.Request, err)
	}
}

func TestAFrameThatFails(t *testing.T) {
	b := newBench(t, listsScene)
	b.rounds(t, map[string]func(){"j1": b.finish(t, "j1"), "j3": b.finish(t, "j3"), "j2": func() {
		b.farm.Update("j2", "state", "", func(s *job.Snapshot) { s.State, s.Error = job.Failed, "no light" })
	}})
	code := b.run(t, "render", b.scene, "--frames", "1-3", "-o", b.path("#.exr"))
	if code != 1 || !strings.HasSuffix(b.stderr.String(), "metrofarm: frame 2: no light\n") {
		t.Errorf("exit code %d: %s", code, b.stderr.String())
	}
	for name, there := range map[string]bool{"1.exr": true, "2.exr": false, "3.exr": true} {
		if _, err := os.Stat(b.path(name)); (err == nil) != there {
			t.Errorf("%s: %v", name, err)
		}
	}
}

func TestAnInterruptEndsASequenceWithItsFrame(t *testing.T) {
	b := newBench(t, listsScene)
	b.rounds(t, map[string]func(){"j1": func() { b.interrupts <- os.Interrupt }})
	code := b.run(t, "render", b.scene, "--frames", "1-3", "-o", b.path("#.exr"))
	if code != 1 || !strings.Contains(b.stderr.String(), "interrupted: 2 frames not rendered") {
		t.Errorf("exit code %d: %s", code, b.stderr.String())
	}
	if _, err := os.Stat(b.path("1.exr")); err != nil {
		t.Error(err)
	}
	q, err := b.farm.Sequence(t.Context(), "seq-1")
	if err != nil || q.States[job.Done] != 1 || q.States[job.Canceled] != 2 {
		t.Errorf("%+v, error %v", q, err)
	}
}

// newRemote makes a bench whose commands go to a server with the bench's farm.
func newRemote(t *testing.T) *bench {
	t.Helper()
	b := newBench(t, listsScene)
	handler, err := api.NewHandler(api.Options{Service: b.farm.Farm, Scenes: b.farm.library})
	if err != nil {
		t.Fatal(err)
	}
	server := httptest.NewServer(handler)
	t.Cleanup(server.Close)
	getenv := b.env.Getenv
	b.env.Getenv = func(name string) string {
		if name == serverVariable {
			return server.URL
		}
		return getenv(name)
	}
	return b
}

func (b *bench) expect(t *testing.T, arguments []string, lines ...string) {
	t.Helper()
	b.stdout.Reset()
	b.stderr.Reset()
	if code := b.run(t, arguments...); code != 0 {
		t.Fatalf("%v: exit code %d, %s", arguments, code, b.stderr.String())
	}
	words := strings.Join(strings.Fields(b.stdout.String()), " ")
	for _, line := range lines {
		if !strings.Contains(words, line) {
			t.Errorf("%v printed %q, without %q", arguments, words, line)
		}
	}
}

func TestSequencesOnAServer(t *testing.T) {
	b := newRemote(t)
	b.expect(t, []string{"submit", b.scene, "--frames", "3-5"}, "seq-1")
	b.farm.Update("j2", "state", "", func(s *job.Snapshot) { s.State, s.Error = job.Failed, "no light" })
	b.expect(t, []string{"sequences"}, "ID NAME USER FRAMES STATE CREATED seq-1", "3-5 rendering, 0 of 3 done, 1 failed")
	b.expect(t, []string{"sequence", "seq-1"}, "3 j1 0.114583 to 0.135417 s 0 queued 0% 0 - -", "4 j2", "failed 0% 0 - no light")
	b.expect(t, []string{"job", "j3"}, "frame 5 of sequence seq-1")
	b.expect(t, []string{"pause", "seq-1"}, "seq-1 rendering, 0 of 3 done, 1 failed")
	b.expect(t, []string{"sequence", "seq-1", "--json"}, `"paused": true`, `"png": "/v1/jobs/j3/image.png"`)
	b.expect(t, []string{"cancel", "seq-1"}, "seq-1 failed, 0 of 3 done, 1 failed, 2 canceled")
	if code := b.run(t, "finish", "seq-1"); code == 0 || !strings.Contains(b.stderr.String(), "seq-1 is a sequence") {
		t.Errorf("exit code %d: %s", code, b.stderr.String())
	}
}

func TestSubmitWaitsForFrames(t *testing.T) {
	b := newRemote(t)
	b.rounds(t, map[string]func(){"j1": b.finish(t, "j1"), "j2": b.finish(t, "j2")})
	b.expect(t, []string{"submit", b.scene, "--frames", "1-2", "-o", b.path("f##.exr")}, "seq-1")
	for _, name := range []string{"f01.exr", "f02.exr"} {
		if _, err := os.Stat(b.path(name)); err != nil {
			t.Error(err)
		}
	}
}
