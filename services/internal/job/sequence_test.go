package job

import (
	"errors"
	"maps"
	"math"
	"strings"
	"testing"
	"time"
)

func sequenceOf(frames Frames) SequenceRequest {
	return SequenceRequest{Job: Request{Scene: "aa", Entry: "scene.xml", Name: "ball", Seed: 7}, Frames: frames}
}

func TestFramesAreCentredOnTheirTime(t *testing.T) {
	for _, c := range []struct {
		frames        Frames
		number        int
		opens, closes float64
	}{
		{Frames{}, 0, -0.25 / 24, 0.25 / 24}, // 180 degrees at 24 frames per second
		{Frames{}, 48, 47.75 / 24, 48.25 / 24},
		{Frames{FPS: 10, ShutterAngle: at(360)}, 5, 0.45, 0.55},
		{Frames{FPS: 10, ShutterAngle: at(0)}, 5, 0.5, 0.5},
		{Frames{FPS: 10, ShutterAngle: at(90)}, 3, 0.2875, 0.3125},
	} {
		opens, closes := c.frames.Shutter(c.number)
		if math.Abs(opens-c.opens) > 1e-12 || math.Abs(closes-c.closes) > 1e-12 {
			t.Errorf("frame %d of %+v: %v to %v, want %v to %v", c.number, c.frames, opens, closes, c.opens, c.closes)
		}
	}
	// With an open shutter of 360 degrees one frame begins where the last one ended.
	whole := Frames{ShutterAngle: at(360)}
	_, ends := whole.Shutter(3)
	if begins, _ := whole.Shutter(4); begins != ends {
		t.Errorf("frame 3 ends at %v, frame 4 begins at %v", ends, begins)
	}
}

func TestFrameRequests(t *testing.T) {
	for seeds, want := range map[string][]uint64{"": {7, 7, 7}, SeedsShared: {7, 7, 7}, SeedsPerFrame: {10, 14, 18}} {
		s := sequenceOf(Frames{Start: 3, End: 12, Step: 4, Seeds: seeds})
		if err := s.Validate(); err != nil {
			t.Fatal(err)
		}
		if n := s.Frames.Count(); n != 3 {
			t.Fatalf("%d frames", n)
		}
		for i, number := range []int{3, 7, 11} {
			r, f := s.Frame(i), s.NewFrame(i, "j")
			opens, closes := s.Frames.Shutter(number)
			if r.Seed != want[i] || *r.ShutterOpen != opens || *r.ShutterClose != closes || !strings.HasSuffix(r.Name, "ball frame "+[]string{"3", "7", "11"}[i]) {
				t.Errorf("request of frame %d: %+v", number, r)
			}
			if err := r.Validate(); err != nil {
				t.Errorf("request of frame %d: %v", number, err)
			}
			if f.Number != number || f.Seed != r.Seed || f.ShutterOpen != opens || f.ShutterClose != closes || f.State != Deleted {
				t.Errorf("frame %d: %+v", number, f)
			}
		}
	}
	long := sequenceOf(Frames{Start: 999_999, End: 999_999})
	long.Job.Name = strings.Repeat("ä", 100)
	r := long.Frame(0)
	if err := r.Validate(); err != nil || !strings.HasSuffix(r.Name, "ä frame 999999") {
		t.Errorf("name %q: %v", r.Name, err)
	}
}

func TestSequenceRefusalsNameTheField(t *testing.T) {
	for name, c := range map[string]struct {
		change func(*SequenceRequest)
		field  string
		says   string
	}{
		"start":    {func(s *SequenceRequest) { s.Frames.Start = -1 }, "frames.start", "0..999999"},
		"end":      {func(s *SequenceRequest) { s.Frames.Start = 10 }, "frames.end", "10"},
		"far":      {func(s *SequenceRequest) { s.Frames.End = 1_000_000 }, "frames.end", "999999"},
		"step":     {func(s *SequenceRequest) { s.Frames.Step = -1 }, "frames.step", "-1"},
		"fps":      {func(s *SequenceRequest) { s.Frames.FPS = -24 }, "frames.fps", "-24"},
		"no fps":   {func(s *SequenceRequest) { s.Frames.FPS = math.NaN() }, "frames.fps", "NaN"},
		"angle":    {func(s *SequenceRequest) { s.Frames.ShutterAngle = at(-1) }, "frames.shutter_angle", "3600"},
		"seeds":    {func(s *SequenceRequest) { s.Frames.Seeds = "random" }, "frames.seeds", "per-frame"},
		"many":     {func(s *SequenceRequest) { s.Frames.End = 1001 }, "frames.end", "1001 frames"},
		"job":      {func(s *SequenceRequest) { s.Job.Integrator = "magic" }, "job.integrator", "mmlt"},
		"stop":     {func(s *SequenceRequest) { s.Job.Stop.Rounds = -1 }, "job.stop.rounds", "1..64"},
		"inspect":  {func(s *SequenceRequest) { s.Job.InspectOnly = true }, "job.inspect_only", "single jobs"},
		"resolved": {func(s *SequenceRequest) { s.Job.Resolved = "{}" }, "job.resolved", "single jobs"},
		"open":     {func(s *SequenceRequest) { s.Job.ShutterOpen = at(0) }, "job.shutter_open", "frames"},
		"close":    {func(s *SequenceRequest) { s.Job.ShutterClose = at(0) }, "job.shutter_close", "frames"},
		"slow":     {func(s *SequenceRequest) { s.Frames.FPS = 1e-300 }, "frames.fps", "outside -1e+09..1e+09 seconds"},
		"ages":     {func(s *SequenceRequest) { s.Frames.FPS = 5e-9 }, "frames.fps", "makes shutters open between 1.5e+08 and 1.05e+09"},
		"large": {func(s *SequenceRequest) {
			s.Frames.End, s.Job.Defaults = 1000, map[string]string{"a": strings.Repeat("x", 40_000)}
		}, "frames.end", "1000 frames with requests of 40"},
		"escaped": {func(s *SequenceRequest) {
			s.Frames.End, s.Job.Defaults = 500, map[string]string{"a": strings.Repeat("\x01", 20_000)}
		}, "frames.end", "500 frames with requests of 120"},
		"instant camera": {func(s *SequenceRequest) {
			s.Job.Exposure, s.Frames.ShutterAngle = ExposureCamera, at(0)
		}, "job.exposure", "open for some time"},
	} {
		s := sequenceOf(Frames{Start: 1, End: 5})
		c.change(&s)
		var wrong *FieldError
		if err := s.Validate(); !errors.As(err, &wrong) || wrong.Field != c.field || !strings.Contains(wrong.Detail, c.says) {
			t.Errorf("%s: %v", name, err)
		}
	}
	for _, frames := range []Frames{{Start: 1, End: 1000}, {}, {End: 1, FPS: 2e-9}, {End: 999_999, Step: 1001, ShutterAngle: at(720)}} {
		s := sequenceOf(frames)
		if err := s.Validate(); err != nil {
			t.Errorf("%+v: %v", frames, err)
		}
	}
}

func TestSequenceStates(t *testing.T) {
	for _, c := range []struct {
		states []State
		want   State
	}{
		{[]State{Queued, Queued}, Queued},
		{[]State{Inspecting, Queued}, Rendering},
		{[]State{Done, Queued}, Rendering},
		{[]State{Failed, Rendering}, Rendering},
		{[]State{Done, Failed, Canceled}, Failed},
		{[]State{Done, Canceled, Deleted}, Canceled},
		{[]State{Done, Deleted}, Done},
	} {
		s := NewSequence("seq-1", "ada", sequenceOf(Frames{}), time.Time{}, c.states)
		counts := make(map[State]int)
		for _, state := range c.states {
			counts[state]++
		}
		if s.State != c.want || !maps.Equal(s.States, counts) {
			t.Errorf("%v: %s, %v", c.states, s.State, s.States)
		}
	}
}
