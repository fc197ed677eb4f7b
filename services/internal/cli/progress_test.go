package cli

import (
	"bytes"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
)

func TestPercentIsFlooredAndNever100BeforeDone(t *testing.T) {
	for _, c := range []struct {
		state    job.State
		progress float64
		want     int
	}{
		{job.Rendering, 0, 0},
		{job.Rendering, 0.42999, 42},
		{job.Rendering, 0.9999, 99},
		{job.Rendering, 1, 99},
		{job.Rendering, 1.5, 99},
		{job.Rendering, -1, 0},
		{job.Failed, 1, 99},
		{job.Done, 1, 100},
		{job.Done, 0.5, 100},
	} {
		if got := percent(job.Snapshot{State: c.state, Progress: c.progress}); got != c.want {
			t.Errorf("%s at %v: %d, want %d", c.state, c.progress, got, c.want)
		}
	}
}

func TestProgressLine(t *testing.T) {
	relMSE := 0.00123
	s := job.Snapshot{
		State: job.Rendering, Progress: 0.5, RoundsDone: 4, MutationsPerSecond: 1_234_567, RelMSE: &relMSE,
		RelMSEInterval: &job.Interval{Low: 0.001, High: 0.0016}, ETASeconds: 61.2,
	}
	want := " 50%  round 5  1.23 M mutations/s  relMSE 0.0012 (0.001 to 0.0016)  ETA 1m02s"
	if got := progressLine(s); got != want {
		t.Errorf("%q, want %q", got, want)
	}
	s.Paused, s.RelMSE, s.MutationsPerSecond, s.ETASeconds = true, nil, 0, 0
	if got := progressLine(s); got != " 50%  round 5 (paused)" {
		t.Errorf("%q", got)
	}
	if got := progressLine(job.Snapshot{State: job.Inspecting, Activity: "loading meshes"}); got != "  0%  inspecting, loading meshes" {
		t.Errorf("%q", got)
	}
	if got := progressLine(job.Snapshot{State: job.Done, RoundsDone: 1}); got != "100%  done, 1 round" {
		t.Errorf("%q", got)
	}
}

func TestMetricAndDuration(t *testing.T) {
	for x, want := range map[float64]string{0.5: "0.5", 999: "999", 999.7: "1 k", 12_345: "12.3 k", 2e9: "2 G", 5e15: "5e+03 T"} {
		if got := metric(x); got != want {
			t.Errorf("metric(%v) = %q, want %q", x, got, want)
		}
	}
	for x, want := range map[float64]string{0.2: "1s", 59.5: "1m00s", 3600: "1h00m", 90_000: "25h00m", 1e300: "over 99h"} {
		if got := duration(x); got != want {
			t.Errorf("duration(%v) = %q, want %q", x, got, want)
		}
	}
}

func TestReporterOnATerminalRedrawsOneLine(t *testing.T) {
	var out bytes.Buffer
	r := &reporter{w: &out, terminal: true}
	r.report(job.Snapshot{State: job.Inspecting, Activity: "a long activity"})
	r.report(job.Snapshot{State: job.Queued})
	r.end(job.Snapshot{State: job.Done, Progress: 1})
	text := out.String()
	if strings.Count(text, "\n") != 1 || strings.Count(text, "\r") != 3 || !strings.Contains(text, "["+strings.Repeat("#", barWidth)+"]") {
		t.Errorf("%q", text)
	}
}

func TestReporterElsewherePrintsChangesOnly(t *testing.T) {
	var out bytes.Buffer
	r := &reporter{w: &out}
	for range 3 {
		r.report(job.Snapshot{State: job.Queued})
	}
	if got := out.String(); got != "  0%  queued\n" {
		t.Errorf("%q", got)
	}
}
